// Checks a scenario and puts it into SI, as scenario.py and problem.py do. Types, ranges and names come from them (DATA);
// what stands here is what belongs together, and what this page leaves to the command.

/** What this page does not compute: keys that may not be given, or not with another value than this one. */
const LEFT_TO_THE_COMMAND = {
    base: ["robots from files"],
    tip: ["robots from files"],
    uncertainty: ["uncertain numbers"],
    "motion.kind": ["trajectories", "line"],
    "motion.file": ["trajectories"],
    "motion.contact_onset_s": ["trajectories"],
    "contact.kind": ["free contact", "clamped"],
    "contact.body_mass_kg": ["free contact"],
    "contact.arm": ["free contact", "position_driven"],
    "contact.damping_Ns_m": ["bodies with damping", 0],
    "contact.gauge_spring_N_m": ["gauges"],
    "contact.gauge_mass_kg": ["gauges"],
    "detector.residuals": ["measured noise"],
    "reaction.stopping_table": ["stopping tables"],
    "reaction.payload_kg": ["stopping tables"],
    "reaction.payload_percent": ["stopping tables"],
    "verdict.clamped_limit": ["two phases of contact", "quasi_static"],
};

function leftToTheCommand(key, what) {
    return new Refusal(key, `this page does not compute ${what}`, "bumpstop evaluate does");
}

/** A value by its key with dots between tables; undefined where it is not given. */
function given(tables, key) {
    return key.split(".").reduce((here, part) => (isTable(here ?? 0) ? here[part] : undefined), tables);
}

/** The keys that say the same as one in its other spelling. */
function otherSpelling(key) {
    const pair = DATA.spellings.find(([one, other]) => [...one, ...other].includes(key));
    return pair ? pair[pair[0].includes(key) ? 1 : 0] : [];
}

/** The value of a schema's type and range, or a refusal. */
function checkValue(key, value, schema) {
    if (schema.anyOf) {
        const lists = Array.isArray(value);
        const fitting = schema.anyOf.filter((one) => one.type !== "null" && (one.type === "array") === lists);
        if (fitting.length !== 1) throw new Refusal(key, `${written(value)} cannot be used`);
        return checkValue(key, value, fitting[0]);
    }
    const wrong = () => new Refusal(key, `${written(value)} cannot be used`, `wanted ${wanted(schema)}`);
    switch (schema.type) {
        case "array": {
            if (!Array.isArray(value)) throw wrong();
            if (value.length < (schema.minItems ?? 0) || value.length > (schema.maxItems ?? Infinity)) throw wrong();
            return value.map((item, i) => checkValue(`${key}[${i + 1}]`, item, schema.items));
        }
        case "string":
            if (typeof value !== "string" || (schema.enum && !schema.enum.includes(value))) throw wrong();
            return value;
        case "integer":
        case "number": {
            const number = schema.type === "number" && value instanceof Real ? value.value : value;
            if (typeof number !== "number") throw wrong();
            if (schema.type === "integer" && !Number.isInteger(number)) throw wrong();
            if ("minimum" in schema && !(number >= schema.minimum)) throw wrong();
            if ("maximum" in schema && !(number <= schema.maximum)) throw wrong();
            if ("exclusiveMinimum" in schema && !(number > schema.exclusiveMinimum)) throw wrong();
            if ("exclusiveMaximum" in schema && !(number < schema.exclusiveMaximum)) throw wrong();
            return number;
        }
        default:
            throw wrong();
    }
}

function written(value) {
    if (value instanceof Real) return String(value.value);
    return Array.isArray(value) ? `[${value.map(written).join(", ")}]` : JSON.stringify(value);
}

function wanted(schema) {
    if (schema.enum) return schema.enum.map((word) => `'${word}'`).join(" or ");
    if (schema.type === "string") return schema.description ?? "a text";
    if (schema.type === "array" && schema.items.type === "string") return "a list of texts";
    if (schema.type === "array")
        return schema.minItems !== undefined ? `a list of ${schema.minItems} numbers` : "a list of numbers";
    const kind = schema.type === "integer" ? "a whole number" : "a number";
    const low = schema.minimum ?? schema.exclusiveMinimum;
    const high = schema.maximum ?? schema.exclusiveMaximum;
    if (low === undefined) return kind;
    if ("exclusiveMinimum" in schema) return `${kind} between ${general(low)} and ${general(high)}`;
    return high === undefined ? `${kind} from ${general(low)}` : `${kind} from ${general(low)} to ${general(high)}`;
}

/** A table of the scenario by its schema, its defaults filled in; `set` has the names of the keys that were given. */
function checkTable(table, schema, prefix) {
    if (!isTable(table))
        throw new Refusal(prefix.slice(0, -1), `${written(table)} cannot be used`, "wanted a table");
    for (const key of Object.keys(table))
        if (!Object.hasOwn(schema.properties, key))
            throw new Refusal(
                `${prefix}${key}`,
                "is not a key of a scenario",
                `valid: ${Object.keys(schema.properties).join(", ")}`,
            );
    const out = { set: new Set(Object.keys(table)) };
    for (const [key, property] of Object.entries(schema.properties)) {
        const inner = property.$ref && DATA.schema.$defs[property.$ref.split("/").pop()];
        if (inner) {
            if (table[key] === undefined && schema.required?.includes(key))
                throw new Refusal(`${prefix}${key}`, "is missing", `wanted a table: [${key}]`);
            out[key] = checkTable(table[key] ?? Object.create(null), inner, `${prefix}${key}.`);
        } else if (table[key] !== undefined) {
            out[key] = checkValue(`${prefix}${key}`, table[key], property);
        } else if (schema.required?.includes(key) && key !== "velocity_mm_s") {
            throw new Refusal(`${prefix}${key}`, "is missing", `wanted ${wanted(property)}`);
        } else {
            out[key] = property.default ?? null;
        }
    }
    return out;
}

/** The scenario of a file's tables: types and ranges checked, defaults filled in. */
function checkScenario(tables) {
    for (const [key, [what, ...same]] of Object.entries(LEFT_TO_THE_COMMAND)) {
        const value = given(tables, key);
        const plain = value instanceof Real ? value.value : value;
        if (plain === undefined || same.includes(plain)) continue;
        throw leftToTheCommand(key, what);
    }
    const arm = isTable(tables.arm ?? 0) ? Object.keys(tables.arm) : [];
    const soft = arm.find((key) => key !== "model" || tables.arm.model !== "rigid");
    if (soft) throw leftToTheCommand(`arm.${soft}`, "arms that give way");
    const scenario = checkTable(tables, DATA.schema, "");
    for (const [one, other] of DATA.spellings) {
        const first = one.find((key) => given(tables, key) !== undefined);
        const second = other.find((key) => given(tables, key) !== undefined);
        if (first && second) throw new Refusal(first, `and ${second} are both given`, "give one of them");
    }
    const isGiven = (key) => key !== "assumed" && given(tables, key) !== undefined && !isTable(given(tables, key));
    for (const key of scenario.assumed)
        if (![key, ...otherSpelling(key)].some(isGiven))
            throw new Refusal("assumed", `${written(key)} is no key that is given here`);
    const fall = Math.hypot(...scenario.gravity_m_s2);
    const [low, high] = DATA.numbers.free_fall;
    if (!(low <= fall && fall <= high))
        throw new Refusal("gravity_m_s2", `is ${general(fall)} m/s2 in all`, `wanted ${low} to ${high} in all, as [0, 0, 9.80665] on a ceiling or [-9.80665, 0, 0] on a wall`);
    checkMotion(scenario.motion);
    checkContact(scenario.contact);
    checkDetector(scenario.detector);
    checkReaction(scenario.reaction);
    const { step_s, substeps } = scenario.simulation;
    const least = DATA.numbers.min_substep_s;
    if (step_s / substeps < least * (1 - 1e-9))
        throw new Refusal(
            "simulation.substeps",
            `${substeps} in a step of ${general(step_s)} s are too many`,
            `wanted at least ${general(least)} s each`,
        );
    if (scenario.pose_deg === null && scenario.pose_rad === null)
        throw new Refusal("pose_deg", "is missing", "give pose_deg or pose_rad, one of them");
    return scenario;
}

function checkDirection(key, direction) {
    if (Math.hypot(...direction) < 1e-6)
        throw new Refusal(key, `${written(direction)} is no direction`, "wanted three numbers, not all zero");
}

function checkMotion(motion) {
    const { speed_mm_s, direction } = motion;
    if ((speed_mm_s === null) !== (direction === null)) {
        const [missing, there] = direction === null ? ["direction", "speed_mm_s"] : ["speed_mm_s", "direction"];
        throw new Refusal(`motion.${missing}`, "is missing", `motion.${there} needs it, or give motion.velocity_mm_s alone`);
    }
    if (speed_mm_s !== null) {
        checkDirection("motion.direction", direction);
        const along = speed_mm_s / Math.hypot(...direction);
        motion.velocity_mm_s = direction.map((part) => along * part);
    }
    if (motion.velocity_mm_s === null)
        throw new Refusal("motion.velocity_mm_s", "is missing", "wanted a list of 3 numbers");
    const speed = Math.hypot(...motion.velocity_mm_s);
    if (speed === 0)
        throw new Refusal("motion.velocity_mm_s", "is zero", "an arm that does not move hits nothing: give a direction");
    const least = DATA.numbers.min_speed_mm_s;
    if (speed < least)
        throw new Refusal("motion.velocity_mm_s", `is ${general(speed)} mm/s in all`, `wanted at least ${least}`);
    motion.held_joints.forEach((number, i) => {
        if (motion.held_joints.indexOf(number) !== i)
            throw new Refusal("motion.held_joints", `joint ${number} is named twice`, "name each once");
    });
}

function checkContact(contact) {
    if (contact.stiffness_N_mm !== null) contact.stiffness_N_m = 1e3 * contact.stiffness_N_mm;
    if (contact.body === null && contact.stiffness_N_m === null)
        throw new Refusal("contact.body", "is missing", "name a body region, or give contact.stiffness_N_m without one");
    if (contact.normal !== null) checkDirection("contact.normal", contact.normal);
    if (contact.offset_law === "fixed" && contact.offset_mm === null)
        throw new Refusal("contact.offset_mm", "is missing", 'offset_law = "fixed" needs it');
    if (contact.offset_law !== "fixed" && contact.offset_mm !== null)
        throw new Refusal(
            "contact.offset_mm",
            `has no meaning with offset_law = "${contact.offset_law}"`,
            'leave it out, or give offset_law = "fixed"',
        );
}

function checkDetector(detector) {
    const { min_threshold_Nm: least, max_threshold_Nm: most } = DATA.numbers;
    detector.thresholds_Nm.forEach((threshold, j) => {
        if (!((threshold >= least && threshold <= most) || threshold === Infinity))
            throw new Refusal(
                `detector.thresholds_Nm[${j + 1}]`,
                `${general(threshold)} cannot be used`,
                `wanted a number from ${general(least)} to ${general(most)}, or inf to leave the joint unmonitored`,
            );
    });
    if (detector.noise_sd_Nm === null) throw new Refusal("detector.noise_sd_Nm", "is missing");
}

function checkReaction(reaction) {
    const law = reaction.deceleration;
    if (law === "table") throw leftToTheCommand("reaction.deceleration", "stopping tables");
    for (const [key, own] of Object.entries(DATA.law_keys)) {
        const there = reaction[key] !== null;
        if (there && own !== law)
            throw new Refusal(`reaction.${key}`, `has no meaning with deceleration = "${law}"`, "leave it out");
        if (!there && own === law && DATA.needed_law_keys.includes(key))
            throw new Refusal(`reaction.${key}`, "is missing", `deceleration = "${law}" needs it`);
    }
    const category = reaction.stop_category;
    if ((category === 0 || category === 1) && reaction.kind === "reverse")
        throw new Refusal("reaction.stop_category", `${category} takes the power from the drives, and kind = "reverse" needs it`);
    if (category === 0 && law === "constant_time")
        throw new Refusal("reaction.stop_category", '0 is a stop by brakes alone, and deceleration = "constant_time" one that drives control');
}
