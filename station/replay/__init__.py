"""``davpc replay``: recorded inputs through a node's own step again, bit for bit or with another setting."""
