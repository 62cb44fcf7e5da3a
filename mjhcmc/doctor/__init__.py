"""What ``mjhcmc doctor`` looks at: packages, optional parts, compiled code, pictures, and a small solve.

Nothing heavy is imported here: what may be broken is tried in processes of its own, whose failure is a finding.
"""
