"""The nonlinear program of a spec in CasADi:  built once, solved by Ipopt many times."""
