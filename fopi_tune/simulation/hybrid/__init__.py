"""Two switched loops in continuous time:  a hybrid inclusion with located jumps; its controllers are filters."""
