"""What two encoders alone tell of a gear pair: ratio, run-out, lost counts."""
