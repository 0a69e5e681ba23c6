// A scenario to its figures: those of `bumpstop evaluate --json`, by the same names.

/** The distribution of one quantity, as ExactDistribution in distribution.py. */
class Quantity {
    constructor(core, name, { mean, sd, condition = 1, undetected = 0, scale = 1 }) {
        Object.assign(this, { core, name, condition, undetected, scale });
        const exists = condition > 0;
        this.mean = exists ? mean * scale : NaN;
        this.sd = exists ? sd * scale : NaN;
        this.given = { mean, sd, condition, undetected };
    }

    scaled(factor) {
        return new Quantity(this.core, this.name, { ...this.given, scale: this.scale * factor });
    }

    /** P(quantity > x), of the peak force. */
    exceedance(x) {
        if (x < 0) return 1;
        const { far } = DATA.numbers;
        let tail = this.core.tail(x / this.scale);
        if (tail < far && this.undetected < far) tail = this.core.far_tail(x / this.scale);
        return Math.min(1, (tail + this.undetected) / this.condition);
    }

    quantile(p) {
        if (!(this.condition > 0)) return NaN;
        return this.core.upper_quantile(this.name, (1 - p) * this.condition, this.undetected) * this.scale;
    }

    figures() {
        const found = { mean: this.mean, sd: this.sd };
        for (const [name, p] of Object.entries(DATA.quantiles)) found[name] = this.quantile(p);
        for (const [name, value] of Object.entries(found)) if (!Number.isFinite(value)) found[name] = null;
        return found;
    }
}

/** Where the contact point is when the motion begins, and how the body lies before it. */
function begin(problem, collision) {
    const { scenario, robot, request } = problem;
    const { motion, contact } = scenario;
    const start = collision.start();
    if (start.singular && motion.damping === 0)
        throw new Refusal(
            scenario.pose_deg !== null ? "pose_deg" : "pose_rad",
            "is singular: no finite joint rates move the tip as motion.velocity_mm_s asks",
            "give another pose, or motion.damping",
        );
    if (!(start.approach_speed > 1e-9))
        throw new Refusal(
            contact.normal !== null ? "contact.normal" : "contact.link",
            `the contact point on ${contact.link ?? robot.tip_name} does not move toward the body`,
            "give a point that moves, and a normal that points the way it goes",
        );
    const sizes = {
        half_normal: () => contact.offset_sd_s * start.approach_speed,
        uniform: () => request.period * request.step * start.approach_speed,
        fixed: () => contact.offset_mm / 1e3,
    };
    return { ...start, offset: sizes[contact.offset_law]() };
}

/** Throws a Refusal where a scenario's text cannot be computed here. `core` is the compiled module. */
function check(core, text) {
    const problem = collisionProblem(checkScenario(readToml(text)));
    const collision = new core.Collision(problem.request);
    try {
        begin(problem, collision);
    } finally {
        collision.delete();
    }
}

/**
 * What this page says of a scenario's text, but for finerStepsWarning. Throws a Refusal.
 *
 * In `told` are the keys of `bumpstop evaluate --json`; beside it stand the problem, the points of the curve, the distances
 * after every step [m] and the quantiles that are asked for later.
 */
function evaluate(core, text) {
    return evaluateProblem(core, collisionProblem(checkScenario(readToml(text))));
}

function evaluateProblem(core, problem) {
    const collision = new core.Collision(problem.request);
    try {
        const start = begin(problem, collision);
        collision.integrate(problem.scenario.contact.offset_law, start.offset);
        return resultOf(problem, collision, start);
    } finally {
        collision.delete();
    }
}

function resultOf(problem, collision, start) {
    const { contact } = problem.scenario;
    const law = collision.figures();
    const undetected = Math.min(1, Math.max(0, law.undetected));
    const detected = law.after_contact + law.false_alarm;
    const peak = new Quantity(collision, "peak_force", {
        mean: law.mean,
        sd: law.sd,
        undetected: law.rests ? 0 : undetected,
    });
    const after = (name) => new Quantity(collision, name, { ...law[name], condition: law.after_contact });
    const pressure = peak.scaled(contact.peak_factor / contact.area_cm2);
    const result = {
        peak_force_N: peak.figures(),
        pressure_N_cm2: pressure.figures(),
        compression_mm: peak.scaled(1e3 / problem.bodyStiffness).figures(),
        force_at_detection_N: after("force_at_detection").figures(),
        detection_delay_s: after("detection_delay").figures(),
        trigger_joint_probability: law.trigger.map((p) => (detected > 0 ? Math.min(1, p / detected) : null)),
        multi_joint_probability: detected > 0 ? Math.min(1, law.multi_joint / detected) : null,
        false_alarm_probability: law.false_alarm,
        undetected_probability: undetected,
        no_contact_probability: Math.max(0, law.no_contact),
        law: "exact",
    };
    const distance = collision.distance();
    const parts = { problem, start, law, peak, pressure, result, distance };
    result.verdict = verdictOf(parts);
    result.verdict.warnings = warningsOf(parts, result.verdict);
    result.notes = notesOf(parts);
    return {
        told: result,
        problem,
        distance,
        approach_speed: start.approach_speed,
        curve: exceedanceCurve(peak),
        // Of the median, and of what is judged by: the collision itself is gone when finer steps are compared.
        median: peak.quantile(0.5),
        judged: peak.quantile(1 - problem.scenario.verdict.accepted_probability),
    };
}

/** Points [N, probability of a higher peak], down to 1e-9: to be drawn, so interpolation will do. */
function exceedanceCurve(peak) {
    const points = [];
    const last = peak.quantile(1 - 1e-9);
    const end = Number.isFinite(last) ? last : peak.quantile(0.5);
    if (!Number.isFinite(end) || !(end > 0)) return points;
    const count = 160;
    for (let k = 0; k <= count; ++k) {
        const force = (end * k) / count;
        points.push([force, Math.min(1, peak.core.tail(force) + peak.undetected)]);
    }
    return points;
}
