"""The live stream as a Foxglove WebSocket server, for who asks for it: a process of its own that only listens."""
