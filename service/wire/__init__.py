"""The wire format: protobuf messages of the contract."""
