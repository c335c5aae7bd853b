"""What has been found: kept in the store, shown in the table of assets."""
