"""What a controller has beside kp + ki s^-alpha:  a derivative, a filter of the measurement."""
