"""One description of a system: bodies, surfaces, contacts, actuators, sensors and cameras, all named.

schema        names, units and ranges of channels, sensors and cameras; travels with every file
system        what is simulated, from the parts below
surfaces      geometry that bodies carry
sensors       named scalars that are read off a state
camera        named views
observation   what sensors read and where surfaces are, at coordinates of a system
description   what a system file may say, in a user's words and units
units, profile, build, file   from such a file to a system
designs       systems that differ in numbers: what a dataset is made of
"""
