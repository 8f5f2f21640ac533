"""Two loops that take turns in continuous time:  a hybrid inclusion with located jumps; its controllers are filters."""
