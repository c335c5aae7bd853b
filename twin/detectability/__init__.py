"""What a rig's instruments can show at all: healthy machines are simulated, with and without one effect, and traced."""
