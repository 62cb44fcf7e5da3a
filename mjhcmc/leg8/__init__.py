"""leg8: the 3-joint, 8-muscle leg, its parameter table, its builder and the fits behind it."""

from mjhcmc.leg8.builder import build_leg8
from mjhcmc.leg8.table import JOINTS, MUSCLES, load_table
from mjhcmc.leg8.xml import leg8_xml, write_leg8

__all__ = ["JOINTS", "MUSCLES", "build_leg8", "leg8_xml", "load_table", "write_leg8"]
