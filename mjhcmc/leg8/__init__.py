"""leg8: the 3-joint, 8-muscle leg, its parameter table, its builder, the fits behind it, and subjects' legs."""

from mjhcmc.leg8.builder import build_leg8, build_leg8_gait
from mjhcmc.leg8.from_osim import leg8_from_osim
from mjhcmc.leg8.table import JOINTS, MUSCLES, load_table
from mjhcmc.leg8.xml import leg8_gait_xml, leg8_xml, write_leg8, write_leg8_gait

__all__ = [
    "JOINTS",
    "MUSCLES",
    "build_leg8",
    "build_leg8_gait",
    "leg8_from_osim",
    "leg8_gait_xml",
    "leg8_xml",
    "load_table",
    "write_leg8",
    "write_leg8_gait",
]
