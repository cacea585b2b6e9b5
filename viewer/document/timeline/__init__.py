"""Keys of camera and pose over time, what plays, and the strip that shows them."""
