"""SkyShield: occupancy as a safety interface for low-altitude UAV autonomy."""
