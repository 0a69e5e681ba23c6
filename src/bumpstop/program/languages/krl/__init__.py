"""KRL, the language of KUKA: its reader, data, inline forms of the smartPAD, system variables and look-ahead."""

from bumpstop.program.languages.krl.reader import parse_krl, read_krl

__all__ = ["parse_krl", "read_krl"]
