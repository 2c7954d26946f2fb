"""SkyOcc: the network and its losses, as plain modules."""
