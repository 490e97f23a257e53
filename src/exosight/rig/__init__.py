"""Your own rig: what pictures of it, at known loads, tell of its model."""
