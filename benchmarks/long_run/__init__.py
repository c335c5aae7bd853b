"""What years of operation and many assets cost the service: measured on the service's own process, twin apart."""
