"""What can be told of a run before it is made: exact answers, steps, time."""
