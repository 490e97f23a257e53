"""The published plant: shape families and scenarios, the finger, and both assembled into one robot.

shapes      the five surface families and their parameters (needs NumPy only)
scenarios   the eleven scenarios and their sampling (needs NumPy only)
variation   how fingers, moduli and mountings differ (needs NumPy only)
finger      the hinged finger
assembly    exosuit + finger as a `mechanics.Robot`, and what is read off it
"""
