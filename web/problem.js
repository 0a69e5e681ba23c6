// A checked scenario against its robot and its limit table, in SI: what the compiled core is given, as in problem.py.

/** Rounds as Python does: halves go to the even neighbour. */
function roundEven(x) {
    const low = Math.floor(x);
    if (x - low !== 0.5) return Math.round(x);
    return low % 2 === 0 ? low : low + 1;
}

function nearNames(names) {
    return `valid: ${names.join(", ")}`;
}

/** Robot, limits, notes, and `request`: the numbers of the core. */
function collisionProblem(scenario) {
    if (!Object.hasOwn(DATA.robots, scenario.robot))
        throw new Refusal("robot", `this page has no ${written(scenario.robot)}`, nearNames(Object.keys(DATA.robots)));
    const robot = DATA.robots[scenario.robot];
    const { motion, contact, detector, reaction, simulation } = scenario;
    const notes = [...robot.warnings];
    const limits = limitsOf(contact);
    if (limits !== null && !contact.set.has("area_cm2")) notes.push("Contact area not given: 1 cm² assumed.");
    const bodyStiffness = contact.stiffness_N_m ?? limits.stiffness_N_m;
    let stiffness = bodyStiffness;
    if (contact.padding_N_m !== null) {
        stiffness = 1 / (1 / stiffness + 1 / contact.padding_N_m);
        notes.push(
            `Padding of ${general(contact.padding_N_m)} N/m in series with the body: ${general(stiffness, 5)} N/m together.`,
        );
    }
    const step = simulation.step_s;
    const late = reaction.latency_s + reaction.dead_time_s;
    const latency = Math.ceil(late / step - 1e-9);
    if (Math.abs(latency * step - late) > 1e-9 * step) {
        const what = reaction.dead_time_s ? "Reaction latency and dead time" : "Reaction latency";
        notes.push(`${what} rounded up to ${general(latency * step * 1e3)} ms, whole simulation steps.`);
    }
    const period = stepsOfPeriod(detector.feedback_period_s, step);
    const count = robot.joints.length;
    const threshold = perJoint(detector.thresholds_Nm, count, "detector.thresholds_Nm");
    const request = {
        joints: robot.joints,
        ...lineOf(scenario, robot),
        q: startPose(scenario, robot),
        velocity: motion.velocity_mm_s.map((v) => v / 1e3),
        step,
        substeps: simulation.substeps,
        period,
        latency,
        threshold,
        noise_sd: perJoint(detector.noise_sd_Nm, count, "detector.noise_sd_Nm"),
        noise_mean: perJoint(detector.noise_mean_Nm, count, "detector.noise_mean_Nm"),
        arming_delay: detector.arming_delay_s,
        correlation: detector.noise_correlation,
        filter: detector.residual === "direct" ? 0 : Math.exp(-detector.observer_gain_1_s * period * step),
        acceleration_limit: perJoint(reaction.joint_acceleration_rad_s2, count, "reaction.joint_acceleration_rad_s2"),
        ...decelerationOf(reaction),
        stiffness,
    };
    return { scenario, robot, limits, stiffness, bodyStiffness, notes, request };
}

/** Limits of the body region, or null where only a stiffness is given. */
function limitsOf(contact) {
    if (contact.body === null) return null;
    if (!Object.hasOwn(DATA.limits, contact.limits))
        throw new Refusal(
            "contact.limits",
            `this page has no table ${written(contact.limits)}`,
            nearNames(Object.keys(DATA.limits)),
        );
    const table = DATA.limits[contact.limits];
    if (!Object.hasOwn(table, contact.body))
        throw new Refusal(
            "contact.body",
            `${written(contact.body)} is not a region of ${contact.limits}`,
            nearNames(Object.keys(table)),
        );
    const region = table[contact.body];
    if (contact.pressure_area === null) return region.any;
    if (!Object.hasOwn(region.areas, contact.pressure_area))
        throw new Refusal(
            "contact.pressure_area",
            `${written(contact.pressure_area)} is not a pressure area of ${contact.body} in ${contact.limits}`,
            nearNames(Object.keys(region.areas)),
        );
    return region.areas[contact.pressure_area];
}

function perJoint(value, count, field) {
    if (!Array.isArray(value)) return Array(count).fill(value);
    if (value.length !== count)
        throw new Refusal(field, `has ${value.length} values`, `the robot has ${count} joints: one for each`);
    return value;
}

function stepsOfPeriod(period, step) {
    const steps = roundEven(period / step);
    if (steps < 1 || Math.abs(steps * step - period) > 1e-6 * step)
        throw new Refusal(
            "detector.feedback_period_s",
            `${general(period)} is not a whole number of simulation steps`,
            `wanted a multiple of simulation.step_s = ${general(step)}`,
        );
    return steps;
}

function startPose(scenario, robot) {
    const degrees = scenario.pose_deg !== null;
    const [field, values] = degrees ? ["pose_deg", scenario.pose_deg] : ["pose_rad", scenario.pose_rad];
    if (values.length !== robot.joints.length)
        throw new Refusal(field, `has ${values.length} values`, `${scenario.robot} has ${robot.joints.length} joints`);
    return values.map((value, j) => {
        const joint = robot.joints[j];
        const turns = degrees && !joint.prismatic;
        const q = turns ? value * (Math.PI / 180) : value;
        const low = joint.lower ?? -Infinity;
        const high = joint.upper ?? Infinity;
        if (q >= low && q <= high) return q;
        const shown = [q, low, high].map((x) => general(turns ? x * (180 / Math.PI) : x));
        const unit = turns ? "deg" : joint.prismatic ? "m" : "rad";
        throw new Refusal(
            field,
            `joint ${j + 1} at ${shown[0]} is outside its limits`,
            `valid: ${shown[1]} to ${shown[2]} ${unit}`,
        );
    });
}

/** A point of a named frame, in the frame of the link that carries it [m]. */
function placeOf(robot, name, point) {
    const frame = robot.frames[name];
    const turned = [0, 3, 6].map((row) => point.reduce((sum, x, k) => sum + frame.rotation[row + k] * x, 0));
    return { link: frame.link, point: turned.map((x, k) => frame.origin[k] + x) };
}

function lineOf(scenario, robot) {
    const { motion, contact, simulation } = scenario;
    const count = robot.joints.length;
    for (const number of motion.held_joints)
        if (number < 1 || number > count)
            throw new Refusal("motion.held_joints", `${number} is no joint of ${scenario.robot}`, `valid: 1 to ${count}`);
    const free = [...Array(count).keys()].filter((j) => !motion.held_joints.includes(j + 1));
    const rows = motion.task === "pose" ? 6 : 3;
    if (free.length < rows)
        throw new Refusal("motion.task", `'${motion.task}' needs ${rows} free joints, ${free.length} are free`, "hold fewer");
    const steps = roundEven(motion.duration_s / simulation.step_s);
    if (!(steps >= 1 && steps <= DATA.numbers.max_steps))
        throw new Refusal(
            "motion.duration_s",
            `${motion.duration_s} is ${general(motion.duration_s / simulation.step_s, 7)} simulation steps`,
            `wanted 1 to ${DATA.numbers.max_steps}`,
        );
    const link = contact.link ?? robot.tip_name;
    if (!Object.hasOwn(robot.frames, link))
        throw new Refusal(
            "contact.link",
            `${scenario.robot} has no link ${written(link)}`,
            nearNames(Object.keys(robot.frames)),
        );
    const tip = placeOf(robot, robot.tip_name, [0, 0, 0]);
    const hit = placeOf(robot, link, contact.point_m);
    const length = contact.normal && Math.hypot(...contact.normal);
    return {
        tip_link: tip.link,
        tip_point: tip.point,
        contact_link: hit.link,
        contact_point: hit.point,
        normal: contact.normal && contact.normal.map((x) => x / length),
        task_rows: rows,
        free_joints: free,
        damping: motion.damping,
        steps,
        from_rest: motion.start === "rest",
        lower: robot.joints.map((joint) => joint.lower ?? -Infinity),
        upper: robot.joints.map((joint) => joint.upper ?? Infinity),
        velocity_limit: robot.joints.map((joint) => joint.velocity ?? Infinity),
    };
}

function decelerationOf(reaction) {
    // A ramp of no time is none.
    const law = reaction.deceleration === "ramp" && !reaction.ramp_time_s ? "constant" : reaction.deceleration;
    return {
        reaction: reaction.kind,
        deceleration: law,
        stopping_time: reaction.stopping_time_s ?? 0,
        ramp_time: reaction.ramp_time_s ?? 0,
        independent: reaction.stop_category === 0,
    };
}
