// The verdict in a word, a sentence and its warnings, as verdict.py and verdict_notes.py say it of rigid arms.

/** The object `verdict` of `bumpstop evaluate --json`, without its warnings. */
function verdictOf(parts) {
    const { problem, peak, pressure, law, result } = parts;
    const { limits, scenario } = problem;
    const settings = scenario.verdict;
    const overForce = limits === null ? null : peak.exceedance(limits.force_N);
    const overPressure =
        limits === null || limits.pressure_N_cm2 === null ? null : pressure.exceedance(limits.pressure_N_cm2);
    const falseAlarm = result.false_alarm_probability;
    const alarmOk = falseAlarm <= settings.max_false_alarm;
    const untouched = nothingHit(parts);
    const passes = (p) => p === null || p <= settings.accepted_probability;
    let conclusion = "no_limits";
    if (overForce !== null) {
        if (!passes(overForce) || !passes(overPressure) || !alarmOk) conclusion = "not_acceptable";
        else conclusion = untouched ? "inconclusive" : "acceptable";
    }
    const words = { ...parts, overForce, overPressure, falseAlarm };
    const reason =
        limits === null
            ? "No body region is named, so there is no limit to judge by."
            : faultsOf(words) || untouched || withinLimits(words);
    const period = problem.request.period * problem.request.step;
    const verdict = {
        acceptable: { acceptable: true, not_acceptable: false }[conclusion] ?? null,
        conclusion,
        reason,
        limit_force_N: limits?.force_N ?? null,
        limit_pressure_N_cm2: limits?.pressure_N_cm2 ?? null,
        p_over_force: overForce,
        p_over_pressure: overPressure,
        false_alarm_ok: alarmOk,
        false_alarms_per_hour: (law.alarm_of_tick * 3600) / period,
        accepted_probability: settings.accepted_probability,
        max_false_alarm: settings.max_false_alarm,
    };
    if (limits === null) return verdict;
    return {
        ...verdict,
        limit_table: limits.table,
        limit_kind: "quasi_static",
        limit_force_source: limits.force_source,
        limit_force_status: limits.force_status,
        limit_pressure_area: limits.pressure_area,
        limit_pressure_source: limits.pressure_source,
        limit_pressure_status: limits.pressure_status,
    };
}

/** Figures that are compared with next to nothing are told apart there. */
function probabilityWords(settings) {
    const tiny = Math.min(settings.accepted_probability, settings.max_false_alarm) < DATA.numbers.min_percent;
    return tiny ? smallPercent : percent;
}

/** Why a collision that is never detected has no bound on its force; null where it has one. */
function unboundedBecause({ problem, law }) {
    if (DATA.at_rest.includes(law.end)) return null;
    return `within ${general(problem.scenario.motion.duration_s)} s (motion.duration_s)`;
}

/** What is not within what is accepted; empty where all is. */
function faultsOf(parts) {
    const { problem, overForce, overPressure, falseAlarm, result } = parts;
    const { limits, scenario } = problem;
    if (!limits.permitted) return limits.reason;
    const { accepted_probability: accepted, max_false_alarm } = scenario.verdict;
    const text = probabilityWords(scenario.verdict);
    const because = unboundedBecause(parts);
    const missed = because === null ? 0 : result.undetected_probability;
    const listed = (over) => over !== null && over > accepted && (!(missed > accepted) || over - missed > accepted);
    const said = (p) => apart(p, accepted, text);
    const faults = [];
    if (listed(overForce))
        faults.push(`the peak force exceeds ${general(limits.force_N)} N with probability ${said(overForce)}`);
    if (listed(overPressure))
        faults.push(
            `the pressure exceeds ${general(limits.pressure_N_cm2)} N/cm² with probability ${said(overPressure)}`,
        );
    const more = faults.length || missed > accepted ? `, more than the accepted ${acceptedPercent(accepted)}` : "";
    if (missed > accepted)
        faults.push(`${said(missed)} of collisions are not detected ${because} and count as over every limit`);
    if (falseAlarm > max_false_alarm)
        faults.push(
            `a false alarm comes before contact with probability ` +
                `${apart(falseAlarm, max_false_alarm, text)} (accepted: ${acceptedPercent(max_false_alarm)})`,
        );
    if (!faults.length) return "";
    const rest = faults.length > 2 ? `; also ${faults.slice(2).join(" and ")}` : "";
    const sentence = faults.slice(0, 2).join(" and ") + more + rest;
    return `${sentence[0].toUpperCase()}${sentence.slice(1)}.`;
}

/** How far the worst figure is from being too much. */
function withinLimits({ problem, overForce, overPressure }) {
    const { limits, scenario } = problem;
    const accepted = scenario.verdict.accepted_probability;
    const worst = apart(Math.max(overForce, overPressure ?? 0), accepted, probabilityWords(scenario.verdict));
    const what = overPressure !== null ? "Peak force or pressure exceeds" : "The peak force exceeds";
    return (
        `${what} the limits for ${limits.label} with probability ${worst}, ` +
        `within the accepted ${acceptedPercent(accepted)}.`
    );
}

/** Probability that no force at all is exerted. */
function untouchedShare({ peak }) {
    return 1 - peak.exceedance(0);
}

/** Why most cases touch nothing; empty where most do. */
function nothingHit(parts) {
    const untouched = untouchedShare(parts);
    if (!(untouched > DATA.numbers.max_untouched)) return "";
    const share = percent(untouched);
    const { law, problem, result } = parts;
    if (result.no_contact_probability < untouched / 2)
        return `In ${share} of cases a false alarm keeps the arm from the body: too few collisions to judge.`;
    const ends = {
        joint_limit: ` where joint ${law.end_joint + 1} reaches its limit`,
        singularity: " at a singularity",
    };
    const why = ends[law.end] ?? ` after ${general(problem.scenario.motion.duration_s)} s (motion.duration_s)`;
    return `In ${share} of cases nothing is hit, as the motion ends before contact${why}.`;
}

/** What makes the verdict mean less than it says, as far as this page looks. */
function warningsOf(parts, verdict) {
    return [assumedWarning, untouchedWarning, headWarning, normalWarning, restWarning].flatMap((one) => one(parts, verdict) ?? []);
}

function assumedWarning({ problem }) {
    const { assumed } = problem.scenario;
    if (!assumed.length) return null;
    return (
        `${assumed.join(", ")} ${assumed.length === 1 ? "is" : "are"} ASSUMED, as the scenario says: the verdict holds ` +
        "for these values alone, whatever the cell has."
    );
}

function untouchedWarning(parts, verdict) {
    const { limits } = parts.problem;
    const untouched = untouchedShare(parts);
    if (limits === null || !limits.permitted || untouched > DATA.numbers.max_untouched) return null;
    const over = Math.max(verdict.p_over_force ?? 0, verdict.p_over_pressure ?? 0);
    const alone = over / (1 - untouched);
    const hides = over <= verdict.accepted_probability && verdict.accepted_probability < alone;
    if (!hides && !(untouched > DATA.numbers.much_untouched)) return null;
    const accepted = verdict.accepted_probability;
    const more = hides ? `, more than the accepted ${acceptedPercent(accepted)}` : "";
    return (
        `In ${percent(untouched)} of cases nothing is hit; they count as below every limit. Of the others alone ` +
        `${apart(alone, accepted, (p) => percent(p))} exceed one${more}.`
    );
}

/** Limits of the head are none to work up to. */
function headWarning({ problem }) {
    return problem.limits?.head_note || null;
}

function normalWarning({ problem, start }) {
    if (problem.scenario.contact.normal === null) return null;
    const cosine = start.approach_speed / start.speed;
    if (!(cosine < DATA.numbers.min_cosine)) return null;
    const angle = (180 / Math.PI) * Math.acos(Math.max(-1, Math.min(1, cosine)));
    return (
        `contact.normal lies ${general(angle, 3)} degrees off the motion: the body is approached at ${percent(cosine)} of ` +
        "the speed, and the force is that of this share. Leave contact.normal out for a body across the motion."
    );
}

function restWarning({ problem, start, distance }) {
    const { motion, contact } = problem.scenario;
    if (motion.start !== "rest") return null;
    // The farthest bodies but one in a thousand.
    const scale = contact.offset_law === "half_normal" ? 3.29 : 1;
    const farthest = Math.min(scale * start.offset, distance.reduce((most, s) => Math.max(most, s)));
    const ahead = distance.findIndex((s) => s >= farthest * (1 - 1e-12));
    let speed = 0;
    for (let k = 1; k <= ahead; ++k) speed = Math.max(speed, (distance[k] - distance[k - 1]) / problem.request.step);
    const share = speed / start.approach_speed;
    if (share >= DATA.numbers.full_speed) return null;
    const fixed = contact.offset_law === "fixed";
    const gap = fixed ? "at the distance given" : `within the gap of ${general(1e3 * farthest, 3)} mm`;
    const remedy = fixed
        ? "Give the largest contact.offset_mm there can be"
        : 'Give contact.offset_law = "fixed" and contact.offset_mm';
    return (
        `From rest the arm has reached no more than ${percent(share)} of its speed when it touches, ${gap}: a body ` +
        `farther away is hit harder. ${remedy}, or motion.start = "moving".`
    );
}

/** What was assumed, and how the motion ends: of the notes of the command those that this page has. */
function notesOf(parts) {
    const { problem, law, result, start } = parts;
    const { scenario, request, limits } = problem;
    const { contact, detector } = scenario;
    const notes = [...problem.notes];
    const millimetres = general(start.offset * 1e3, 4);
    if (contact.offset_law === "half_normal")
        notes.push(
            `The body is a half-normal distance away, sd ${millimetres} mm (${general(contact.offset_sd_s)} s of travel).`,
        );
    if (contact.offset_law === "uniform")
        notes.push(`The body is 0 to ${millimetres} mm away, evenly: one feedback period of travel.`);
    if (limits !== null)
        notes.push(
            `Limits: ${limits.table}, ${limits.label}; force: ${limits.force_source} (status: ${limits.force_status}).`,
        );
    const end = `The motion ends after ${general(law.cut_step * request.step, 3)} s`;
    if (law.end === "joint_limit") notes.push(`${end}: joint ${law.end_joint + 1} reaches its limit.`);
    if (law.end === "singularity") notes.push(`${end} near a singularity.`);
    if (law.velocity_limited) notes.push("A joint-velocity limit slows the motion below the speed asked for.");
    const missed = percent(result.undetected_probability, true);
    const because = unboundedBecause(parts);
    if (result.undetected_probability > DATA.numbers.negligible)
        notes.push(
            `${missed[0].toUpperCase()}${missed.slice(1)} of collisions are not detected ` +
                (because === null
                    ? "before the motion ends. They count with the greatest force until the arm stands."
                    : `${because}. They count as over every limit: their force is unbounded and the mean is not given.`),
        );
    if (result.no_contact_probability > DATA.numbers.negligible)
        notes.push(`In ${percent(result.no_contact_probability, true)} of cases the motion ends before contact.`);
    const unmonitored = request.threshold.flatMap((value, j) => (Number.isFinite(value) ? [] : [j + 1]));
    if (unmonitored.length) notes.push(`Not monitored: joint ${unmonitored.join(", ")}.`);
    if (detector.arming_delay_s > 0)
        notes.push(`The detector is not armed for the first ${general(detector.arming_delay_s)} s.`);
    return notes;
}
