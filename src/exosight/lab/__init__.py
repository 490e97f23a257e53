"""`exosight lab`: a local page on which a system, its picture and its sensors are seen while sliders move.

The page holds no physics. Every answer follows from one request alone (there are no sessions), so that any
number of open pages are right at the same time, and what is seen can be made again from the command line.

settings            what a page may ask for: one view, one path, one run of the closed loop
designs             values of a design that can be set, with sliders; those of a system file
published_designs   those of the published system
system              the system that is shown, its commands, and the network that reads its images
controls            how the page shows all that: labels, units, steps
pose_cache          equilibria of systems along the moves that they are driven by, remembered
views               one view: pose, picture, true and estimated readings; the path of a channel
pictures            what the view's camera does to a picture
estimates           what a network reads off a picture, and what the guard makes of it
saving              a view as files
closed_loop         runs of the closed loop, step by step
uploads             pictures that people drop on the page
security            who may ask, and how much: host, token, origin, sizes, headers
server              the addresses (needs the extra `lab`)
page/               HTML, CSS and JavaScript, without anything from elsewhere
"""
