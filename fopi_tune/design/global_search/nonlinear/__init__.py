"""The one nonlinear program that polishes every spec's gains:  its controllers, its slots, a solve of it."""
