"""Studies that the product is not made of: comparisons with published experiments."""
