"""The model of a rig from pictures at known commands.

outlines       edges of the bodies in a picture or a mask
parameters     entries of a system file that are unknown, and their priors
response       poses of the rig, and their exact derivatives by the parameters
distances      of points from the outline that the system has in the picture
misfit         residuals of pictures, and their derivatives
measurements   pictures, commands and readings
fit            the most likely parameters
posterior      intervals, what stays open, what a further picture tells
predicted      the outline that a picture would have
registered     where a camera is, from the device at rest: `register`
result         all of it: `identify`
"""
