"""Methods that davpc is measured against."""
