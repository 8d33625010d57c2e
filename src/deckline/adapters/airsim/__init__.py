"""AirSim's remote procedure calls: msgpack-rpc over TCP."""
