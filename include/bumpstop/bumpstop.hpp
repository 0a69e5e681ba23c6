/// @file
/// What most programs need: robots from files, and the distribution of a collision.
#pragma once

#include "bumpstop/collision/batch.hpp"
#include "bumpstop/collision/collision.hpp"
#include "bumpstop/collision/line_setup.hpp"
#include "bumpstop/model/robot_description.hpp"
