"""What has been found: kept in the store, shown on the board."""
