"""What a plant watches the service by: metrics, health, log lines and traces."""
