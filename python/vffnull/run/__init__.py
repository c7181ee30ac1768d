"""What runs: one scenario, many, one against the clock, a robot; and controllers against each other."""
