"""The wire: topics and protobuf messages of the contract, section 1."""
