"""Collections for hours, in stepped time and with real processes: nothing grows, nothing is lost without a name."""
