"""Equations of motion and of activation on any scalar type: what MuJoCo's numbers are measured against.

Nothing here needs MuJoCo but reading a model (`chain.chain_of`). Modules:

- `chain`: the bodies and joints as plain numbers.
- `scalars`: floats, complex numbers, longdouble, mpmath, python-flint, CasADi: how one computes on each.
- `dynamics`: mass matrix, bias, inverse and forward dynamics of a chain.
- `leg`: the same in closed form, of hinges with parallel axes.
- `reference`: an integrator of any order, and the classical Runge-Kutta.
- `activation`: Thelen's activation dynamics.
"""
