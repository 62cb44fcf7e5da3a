"""Groups of leg8's muscles that spasticity affects together, and which of them a clinical test stretches."""

from __future__ import annotations

GROUPS: dict[str, tuple[str, ...]] = {
    "hip_flexors": ("iliopsoas",),
    "knee_extensors": ("rect_fem", "vasti"),
    "knee_flexors": ("hamstrings",),
    "plantarflexors": ("gastroc", "soleus"),
}
"""Muscles of each group. Glut_max and tib_ant are in none: they are not made spastic."""

TESTED: dict[str, str] = {"hip": "hip_flexors", "knee": "knee_extensors", "ankle": "plantarflexors"}
"""The group that the passive stretch of a joint lengthens: hip extension, knee flexion, ankle dorsiflexion."""
