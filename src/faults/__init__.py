"""What is at fault with sensors, of flights and of frames."""
