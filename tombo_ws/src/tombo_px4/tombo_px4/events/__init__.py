"""What PX4 says: its events, the file that explains them, and how that file is read."""
