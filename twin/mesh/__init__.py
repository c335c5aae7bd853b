"""What a pair of teeth in mesh does: stiffness, corner contact, shared load, back flank."""
