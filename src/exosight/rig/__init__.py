"""Pictures and readings of a real system: read from whatever a laboratory has, stored as a dataset, and the
model that they tell of.

units      SI units of what instruments read
table      CSV files: columns with names and units
pictures   what all sources of pictures have in common: size, part and order
folder     a folder of picture files
video      a video file
matlab     .mat files: pictures and readings in one
bags       recordings of ROS
lerobot    LeRobot datasets: videos or pictures; lerobot_tables: their Parquet files
matching   which row of a table belongs to which picture
readings   sensors, commands and sequences of matched pictures
importing  the dataset made of them: chunk after chunk, resumable
charuco    the lens of a camera from pictures of a board; calibrated_camera: what a system file says of it

identification/  the model of a rig from pictures at known loads
"""
