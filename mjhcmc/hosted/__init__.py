"""Hill muscles hosted outside MuJoCo: the equations of `mjhcmc.hill`, compiled, driving MuJoCo's bodies."""
