"""What a body may take: regions, limit tables, and the force and pressure of clamped contact.

"Schroeder (2013)" whose equations and figures are cited here is K. Schroeder, Requirements for Effective Collision
Detection on Industrial Serial Manipulators, The University of Texas at Austin, 2013.
"""

from bumpstop.contact.clamped import clamped_force, pressure_N_cm2
from bumpstop.contact.contact_limits import ContactLimits
from bumpstop.contact.limits import LimitTable, builtin_tables, form_text, limit_forms
from bumpstop.contact.regions import ContactKind, PressureArea, Region

__all__ = [
    "ContactKind",
    "ContactLimits",
    "LimitTable",
    "PressureArea",
    "Region",
    "builtin_tables",
    "clamped_force",
    "form_text",
    "limit_forms",
    "pressure_N_cm2",
]
