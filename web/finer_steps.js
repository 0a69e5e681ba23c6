// Whether steps and sub-steps are fine enough for the force that is said, as finer_steps.py finds out.

/** Finer steps and sub-steps, as far as they may be; null where these are the finest. */
function finerThan({ step_s, substeps }) {
    const { finer, min_step_s, min_substep_s, max_substeps } = DATA.numbers;
    const step = step_s / finer >= min_step_s ? step_s / finer : step_s;
    const most = Math.min(max_substeps, Math.trunc((step / min_substep_s) * (1 + 1e-9)));
    const more = Math.max(1, Math.min(substeps * finer, most));
    return step / more >= (step_s / substeps) * (1 - 1e-9) ? null : { step, more };
}

/** The warning, or null. `coarse` is what `evaluate` found of the text. */
function finerStepsWarning(core, text, coarse) {
    const { scenario, request, stiffness } = coarse.problem;
    const finer = finerThan(scenario.simulation);
    if (finer === null) return null;
    const { rise, finer: times, max_steps_looked_at } = DATA.numbers;
    const risk = scenario.verdict.accepted_probability;
    if ((scenario.motion.duration_s / request.step) * times > max_steps_looked_at) {
        const way = (coarse.approach_speed * request.step) / request.substeps / 2;
        if (!Number.isFinite(coarse.judged) || !(stiffness * way > rise * coarse.judged)) return null;
        return (
            `Simulation sub-steps of ${general(request.step / request.substeps)} s are coarse: braking distances are up to ` +
            `${general(1e3 * way, 3)} mm shorter for them, which is ${general(stiffness * way, 3)} N. Give a smaller ` +
            "simulation.step_s or more simulation.substeps."
        );
    }
    const tables = readToml(text);
    tables.simulation = { ...tables.simulation, step_s: new Real(finer.step), substeps: finer.more };
    if (scenario.contact.offset_law === "fixed") tables.contact.offset_mm = new Real(samePhase(coarse, finer.step));
    let fine;
    try {
        fine = evaluateProblem(core, collisionProblem(checkScenario(tables)));
    } catch (error) {
        if (!(error instanceof Refusal)) throw error;
        return null; // an edge that only the finer steps reach, or only the coarse ones miss
    }
    const [name, p] = Number.isFinite(coarse.judged) ? ["judged", 1 - risk] : ["median", 0.5];
    const [before, after] = [coarse[name], fine[name]];
    if (!(after > (1 + rise) * before)) return null;
    const much = Number.isFinite(after) ? `${general(after, 4)} N, not` : "without a bound, not";
    const flips = coarse.told.verdict.acceptable === true && fine.told.verdict.acceptable === false;
    return (
        `Simulation steps are coarse: with simulation.step_s = ${general(finer.step)} and simulation.substeps = ` +
        `${finer.more} the peak force (p${general(100 * p)}) is ${much} ${general(before, 4)} N` +
        `${flips ? ", and the verdict is NOT ACCEPTABLE" : ""}.`
    );
}

/** An offset [mm] as much nearer as the first step is shorter, so that the control cycles come as late after contact. */
function samePhase({ problem, distance, approach_speed }, step) {
    const { request, scenario } = problem;
    const offset = scenario.contact.offset_mm;
    const touch = Math.max(0, distance.findIndex((s) => s > offset / 1e3));
    const speed = touch ? (distance[touch] - distance[touch - 1]) / request.step : approach_speed;
    return Math.max(0, offset - 1e3 * speed * (request.step - step));
}
