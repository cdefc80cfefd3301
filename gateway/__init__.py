"""The one process of a robot with a network socket: QUIC, mutual TLS, and an access list from the channel table."""
