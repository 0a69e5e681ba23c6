// Not pluginlib: a class needs no registration where nothing loads it. See ../README.md.
#pragma once

#define PLUGINLIB_EXPORT_CLASS(made, base) static_assert(std::is_base_of_v<base, made>);
