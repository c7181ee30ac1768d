"""Other engines: MuJoCo as the plant, Gymnasium's interface, models for other people's simulators."""
