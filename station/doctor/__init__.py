"""``davpc doctor``: whether this computer and this robot are fit to dock. A check is pure, its probe does the I/O."""
