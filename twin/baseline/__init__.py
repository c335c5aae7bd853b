"""What a machine does when it is well, learned from recordings, where no rig model is known."""
