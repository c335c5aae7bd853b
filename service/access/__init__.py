"""Who may do what: roles, API keys, tokens of an OpenID Connect issuer, and the rule that joins them."""
