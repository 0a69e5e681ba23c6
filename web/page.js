// The page: a scenario's text, and what is said of it.

// Each with its heading, the name in the result, and the factor to its unit.
const ROWS = [
    ["peak force, N", "peak_force_N", 1],
    ["pressure, N/cm²", "pressure_N_cm2", 1],
    ["deformation, mm", "compression_mm", 1],
    ["force at detection, N", "force_at_detection_N", 1],
    ["detection delay, ms", "detection_delay_s", 1e3],
];
const COLUMNS = ["mean", "p50", "p95", "p99", "p999"];
const WORDS = {
    acceptable: "✓ ACCEPTABLE",
    not_acceptable: "✖ NOT ACCEPTABLE",
    inconclusive: "? INCONCLUSIVE",
    no_limits: "NO LIMITS TO JUDGE BY",
};
const NOT_LOOKED_FOR =
    "Not looked for on this page: values that look like another unit's, how long contact lasts, whether a reversing arm " +
    "swings forward again while it presses, and the same arm with elastic gears. bumpstop evaluate does. An engineering " +
    "estimate, not a certified safety function.";
// What takes longer is said to be unfinished [ms].
const UNFINISHED = 300;

function element(name, attributes = {}, ...children) {
    const made = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...children);
    return made;
}

/** A figure with all its digits in `data-value`, by its name in the result. */
function numberCell(name, value, text) {
    return element("td", { "data-number": name, "data-value": String(value) }, text);
}

class Page {
    constructor(root, source) {
        this.root = root;
        this.verdict = element("p", { class: "verdict", role: "status" });
        this.warnings = element("ul", { class: "warnings" });
        this.text = element("textarea", { spellcheck: "false", "aria-label": "Scenario", rows: "24" });
        this.figures = element("div", { class: "figures" });
        const result = element("div", { class: "result" }, this.figures);
        const input = element("div", { class: "input" }, this.choices(), this.text);
        const missing = element("p", { class: "small" }, NOT_LOOKED_FOR);
        root.replaceChildren(this.verdict, this.warnings, missing, element("div", { class: "columns" }, input, result));
        this.computation = new Computation(source, (answer) => this.show(answer));
        this.text.addEventListener("input", () => this.changed());
        addEventListener("hashchange", () => this.open(this.linked() ?? this.text.value));
        this.open(this.linked() ?? DATA.examples[0].text);
    }

    /** The scenario of the page's own address; null where it has none. */
    linked() {
        const found = /^#scenario=(.*)$/.exec(location.hash);
        try {
            return found && decodeURIComponent(found[1]);
        } catch {
            return found[1]; // a damaged address: what it holds is refused in words
        }
    }

    choices() {
        const examples = element("select", { "aria-label": "Example" });
        DATA.examples.forEach(({ name }, k) => examples.append(element("option", { value: String(k) }, name)));
        examples.addEventListener("change", () => this.open(DATA.examples[Number(examples.value)].text));
        const file = element("input", { type: "file", accept: ".toml", hidden: "" });
        file.addEventListener("change", async () => this.open(await file.files[0].text()));
        const link = element("button", { type: "button" }, "Link");
        link.title = "Puts the scenario into the page's address";
        link.addEventListener("click", () =>
            history.replaceState(null, "", `#scenario=${encodeURIComponent(this.text.value)}`),
        );
        return element("div", { class: "choices" }, examples, element("label", {}, "Open a file", file), link);
    }

    open(text) {
        this.text.value = text;
        this.changed();
    }

    /** What was said is of another scenario: it is taken back before anything new is known. */
    changed() {
        this.say("computing", "COMPUTING", "");
        this.figures.classList.add("old");
        this.asked = performance.now();
        const text = this.text.value;
        if (text.length <= DATA.numbers.max_bytes) {
            this.computation.ask(text);
        } else {
            this.computation.forget();
            this.show({ refused: `scenario: has more than ${DATA.numbers.max_bytes} letters` });
        }
    }

    say(kind, word, sentence) {
        clearTimeout(this.unfinished);
        this.root.dataset.state = kind;
        this.verdict.dataset.verdict = kind;
        this.verdict.replaceChildren(element("strong", {}, word), ` ${sentence}`);
        this.warnings.replaceChildren();
    }

    warn(sentence) {
        this.warnings.append(element("li", {}, sentence));
    }

    show(answer) {
        if (answer.refused !== undefined) {
            this.say("refused", "✖ CANNOT BE COMPUTED", answer.refused);
            this.figures.replaceChildren();
            this.root.dataset.state = "done";
            return;
        }
        if (answer.told !== undefined) this.showResult(answer);
        if (!answer.done) return;
        clearTimeout(this.unfinished);
        this.pending.remove();
        if (answer.coarse !== null) this.warn(answer.coarse);
        this.root.dataset.state = "done";
    }

    showResult(answer) {
        const { told, title, took } = answer;
        const { conclusion, reason, warnings } = told.verdict;
        this.say(conclusion, WORDS[conclusion], reason);
        warnings.forEach((one) => this.warn(one));
        this.pending = element("li", { class: "pending" }, "Whether finer simulation steps hit harder is being computed.");
        this.unfinished = setTimeout(() => this.warnings.append(this.pending), UNFINISHED);
        const notes = told.notes.map((note) => element("li", {}, note));
        this.figures.classList.remove("old");
        this.figures.replaceChildren(
            element("h3", {}, title),
            pictureOf(answer),
            element("div", { class: "table-wrapper" }, this.table(told)),
            this.probabilities(told),
            element("details", {}, element("summary", {}, "Notes"), element("ul", {}, ...notes)),
        );
        const milliseconds = [took, performance.now() - this.asked].map((one) => one.toFixed(1));
        this.figures.dataset.took = milliseconds[0];
        this.figures.dataset.shown = milliseconds[1];
    }

    table(told) {
        const heading = element("tr", {}, element("th"), ...COLUMNS.map((name) => element("th", {}, name.replace("999", "99.9"))));
        const rows = ROWS.map(([words, name, factor]) => {
            const cells = COLUMNS.map((column) => {
                const value = told[name][column];
                return numberCell(`${name}.${column}`, value, value === null ? "inf" : figure(value * factor));
            });
            return element("tr", {}, element("th", {}, words), ...cells);
        });
        return element("table", {}, element("thead", {}, heading), element("tbody", {}, ...rows));
    }

    probabilities(told) {
        const { verdict } = told;
        const rows = [
            ["over the force limit", "verdict.p_over_force", verdict.p_over_force, verdict.limit_force_N, "N"],
            ["over the pressure limit", "verdict.p_over_pressure", verdict.p_over_pressure, verdict.limit_pressure_N_cm2, "N/cm²"],
            ["false alarm before contact", "false_alarm_probability", told.false_alarm_probability],
            ["never detected", "undetected_probability", told.undetected_probability],
            ["motion ends before contact", "no_contact_probability", told.no_contact_probability],
        ];
        const body = rows.map(([words, name, value, limit, unit]) => {
            const more = limit === undefined || limit === null ? "" : ` of ${general(limit)} ${unit}`;
            const text = value === null ? "no limit" : decimal(value);
            return element("tr", {}, element("th", {}, words + more), numberCell(name, value, text));
        });
        return element("table", { class: "probabilities" }, element("tbody", {}, ...body));
    }
}

/** Fills the page, computes for it, or exports what tests use. */
function beginPage(load, source) {
    if (typeof document !== "undefined") {
        const root = document.getElementById("bumpstop");
        if (root !== null) new Page(root, source);
    } else if (typeof WorkerGlobalScope !== "undefined") {
        serve(load);
    } else {
        const words = { general, percent, smallPercent, acceptedPercent, decimal };
        module.exports = { load, check, evaluate, finerStepsWarning, readToml, Refusal, ...words };
    }
}
