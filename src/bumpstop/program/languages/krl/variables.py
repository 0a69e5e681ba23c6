"""KRL's system variables: what may be another one after a program has set one of them."""

from __future__ import annotations

from collections.abc import Mapping

from bumpstop.program.languages.statements import Frame

# Those that neither move the arm nor say how it moves, and those that may slow it or change its ramps.
_OUTPUTS = "$out $anout $timer $flag $cycflag $apo $advance $bwdstart $h_pos $load"
_SLOWING = "$vel.ori $acc.ori $vel_extax $acc_extax $gear_jerk $jerk"
_HARMLESS = (*_OUTPUTS.split(), *_SLOWING.split())
# Those that may change speeds, and no more.
_LIMITS = "$vel $acc $ov_pro $red_ $cp_vel_type $dist_next $home $sen_ $softplc $msg $err"
_SPEEDS = (*_LIMITS.split(),)
# Those that may turn the tool in another way or move what targets are given in, and what they are where they do not.
_ORDINARY = {"$ori_type": "#var", "$circ_type": "#base", "$ipo_mode": "#base", "$robroot": ""}
_FRAMES: Mapping[str, tuple[Frame, ...]] = {
    "$tool": ("tool",),
    "$base": ("base",),
    "$act_tool": ("tool", "base"),
    "$act_base": ("tool", "base"),
    **dict.fromkeys(_ORDINARY, ("shift",)),
}
ALL_FRAMES: tuple[Frame, ...] = ("tool", "base", "shift")


def changed_by(name: str, value: str) -> tuple[bool, tuple[Frame, ...]]:
    """Whether speeds may be others after an assignment, and what of tool, frame and what poses mean.

    Args:
        name: of the variable, in small letters.
        value: last word of what it is set to, in small letters.
    """
    whole = name.partition(".")[0]
    if name.startswith(_HARMLESS) or value == _ORDINARY.get(name):
        return False, ()
    if whole in _FRAMES:
        return False, _FRAMES[whole]
    # Of what is not known poses may mean another place, as by an offset of the base.
    return True, () if name.startswith(_SPEEDS) else ALL_FRAMES
