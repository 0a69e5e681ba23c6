// One of several files of a program, each compiled for another instruction set: tells what a type with registers is
// called there. `WHERE` names the function; the file with `main` asks all.
#include <typeinfo>

#include "bumpstop/joint/joint_torque_batch.hpp"

const char* WHERE();
const char* WHERE() { return typeid(bumpstop::JointTorqueBank).name(); }
