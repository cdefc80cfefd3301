"""Malformed input against everything that reads: messages, files, overrides, CAN frames."""
