"""AirSim's remote procedure calls: msgpack-rpc over TCP."""

HOST, PORT = "127.0.0.1", 41451  # where AirSim listens
