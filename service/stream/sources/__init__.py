"""Where frames come from: recordings and live streams."""
