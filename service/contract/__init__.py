"""The names and units of the interface contract; nothing else in the project knows them."""
