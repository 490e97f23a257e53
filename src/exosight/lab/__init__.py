"""`exosight lab`: a local page on which the exosuit, its picture and its forces are seen while sliders move.

The page holds no physics. Every answer follows from one request alone (there are no sessions), so that any
number of open pages are right at the same time, and what is seen can be made again from the command line.

settings    what a page may ask for: one view, one run of the closed loop; bounds and starting values
controls    how the page shows those settings: labels, units, steps
pose_cache  equilibria of exosuits along the way that they are driven, remembered
views       one view: pose, picture, true and estimated forces, what the guard makes of it
saving      a view as files, and the command that makes it again
closed_loop runs of the closed loop, step by step
uploads     pictures that people drop on the page
security    who may ask, and how much: host, token, origin, sizes, headers
server      the addresses (needs the extra `lab`)
page/       HTML, CSS and JavaScript, without anything from elsewhere
"""
