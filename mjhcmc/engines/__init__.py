"""Rigid-body engines beside MuJoCo: the same leg, the same numbers, or not.

`registry.all_engines` lists them, `compare.compare` runs them, `urdf.urdf_of` writes a tree of hinges for those that
read URDF. A new engine is a module here with an ``ENGINE`` and a line in `registry.MODULES`.
"""
