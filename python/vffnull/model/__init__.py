"""What people write and get: arms, what is around them, their control, scenarios, and the data of a run."""
