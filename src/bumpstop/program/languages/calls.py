"""Calls of functions inside statements: which there are, and which names they are given."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

from bumpstop.program.languages.syntax import Token

_URSCRIPT = (
    "if elif while return and or not xor switch case acos asin atan atan2 ceil cos sin tan floor log pow sqrt abs "
    "d2r r2d norm normalize random size length inv transpose struct make_list get_list_length "
    "integer_to_binary_list binary_list_to_integer interpolate_pose point_dist pose_add pose_dist pose_inv pose_sub "
    "pose_trans rotvec2rpy rpy2rotvec wrench_trans to_num to_str str_at str_cat str_empty str_find str_len str_sub "
    "get_inverse_kin get_inverse_kin_has_solution get_forward_kin get_actual_joint_positions "
    "get_actual_joint_speeds get_actual_tcp_pose get_actual_tcp_speed get_actual_tool_flange_pose "
    "get_target_joint_positions get_target_joint_speeds get_target_tcp_pose get_target_tcp_speed "
    "get_target_waypoint get_joint_temp get_joint_torques get_tcp_force get_tcp_offset get_target_payload "
    "get_target_payload_cog get_controller_temp get_conveyor_tick_count get_tool_accelerometer_reading "
    "get_tool_current get_steptime get_digital_in get_digital_out get_analog_in get_analog_out "
    "get_standard_digital_in get_standard_digital_out get_standard_analog_in get_standard_analog_out "
    "get_configurable_digital_in get_configurable_digital_out get_tool_digital_in get_tool_digital_out "
    "get_tool_analog_in get_flag is_steady is_within_safety_limits force time powerof2 read_input_boolean_register "
    "read_input_float_register read_input_integer_register read_output_boolean_register read_output_float_register "
    "read_output_integer_register read_port_bit read_port_register modbus_get_signal_status modbus_get_signal_index "
    "request_boolean_from_primary_client request_integer_from_primary_client request_float_from_primary_client"
)
_KRL = (
    "if while until for to step switch case return wait and or not exor b_and b_or b_exor b_not abs acos asin sin "
    "cos tan atan2 sqrt round inv_pos forward inverse strlen strdecllen strcomp strfind varstate "
    # What inline forms of spline moves call, which only look into what they are given.
    "svel_joint svel_cp sacc_joint sacc_cp sgear_jerk sjerk stool2 sbase sipo_mode sload sapo_ptp sapo sori_typ "
    "scirc_typ scirc_m use_cm_pro_values"
)
_RAPID = (
    "if elseif while for from to step do then test case return and or not xor div mod waituntil offs reltool abs "
    "acos asin atan atan2 cos sin tan sqrt pow exp round trunc dim crobt cjointt cpos crot ctool cwobj calcrobt "
    "calcjointt distance dotprod vectmagn eulerzyx orientzyx norient orobt mirpos poseinv posemult posevect "
    "defframe defdframe defaccframe numtostr valtostr strpart strlen strfind strmatch strorder strmap strmemb ctime "
    "cdate gettime clkread testdi dinput doutput ginput goutput ainput aoutput bitand bitor bitxor bitneg bitcheck "
    "bitlsh bitrsh present opmode runmode ispers isvar isstopmoveact taskrunrob taskrunmec robname"
)
# Words before a bracket that call nothing but what only computes or asks.
URSCRIPT_PURE, KRL_PURE, RAPID_PURE = (frozenset(words.split()) for words in (_URSCRIPT, _KRL, _RAPID))


def calls_in(words: Sequence[Token], pure: frozenset[str]) -> list[str]:
    """Names in small letters of the functions that words call, but for those that only compute."""
    return [
        word.text.lower()
        for word, following in pairwise(words)
        if word.kind == "name" and following.text == "(" and word.text.lower() not in pure
    ]


def names_given(words: Sequence[Token], pure: frozenset[str]) -> Iterator[str]:
    """Names in the brackets of such calls, which they may change; of a function's head its parameters."""
    levels: list[bool] = []
    for i, word in enumerate(words):
        if word.text == "(":
            called = i > 0 and words[i - 1].kind == "name" and words[i - 1].text.lower() not in pure
            levels.append(called or any(levels[-1:]))
        elif word.text == ")":
            levels = levels[:-1]
        elif word.kind == "name" and any(levels[-1:]):
            yield word.text


def function_name(words: Sequence[Token]) -> str:
    """Of a function's head: the name before its bracket, in small letters."""
    for word, following in pairwise(words):
        if following.text == "(" and word.kind == "name":
            return word.text.lower()
    return words[-1].text.lower() if len(words) > 1 else ""


def has_parameters(words: Sequence[Token]) -> bool:
    """Whether a function's head has names between its brackets."""
    texts = [word.text for word in words]
    return "(" in texts and any(word.kind == "name" for word in words[texts.index("(") :])
