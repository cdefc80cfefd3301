"""Whole queues in stepped time down to pixels and CAN frames, and what goes wrong at them."""
