// The distribution as a picture: the probability of a higher peak force, on a scale of powers of ten.

const PICTURE = { width: 480, height: 320, left: 62, right: 12, top: 14, bottom: 46, decades: 9 };

function svg(name, attributes, text) {
    const made = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    if (text !== undefined) made.textContent = text;
    return made;
}

/** Round numbers from 0 to an end, some five of them. */
function roundNumbers(end) {
    const power = 10 ** Math.floor(Math.log10(end / 4));
    const step = [1, 2, 5, 10].map((part) => part * power).find((one) => end / one <= 6);
    return Array.from({ length: Math.floor(end / step) + 1 }, (_, k) => k * step);
}

/** The force that either limit allows [N], with its name; empty where there is none. */
function forceLimits(limits, contact) {
    if (limits === null || !limits.permitted) return [];
    const found = [["force limit", limits.force_N]];
    if (limits.pressure_N_cm2 !== null)
        found.push(["pressure limit", (limits.pressure_N_cm2 * contact.area_cm2) / contact.peak_factor]);
    return found.sort((one, other) => one[1] - other[1]);
}

/** An element with the curve, the limits and what is accepted. */
function pictureOf({ curve, limits, contact, told }) {
    const { width, height, left, right, top, bottom, decades } = PICTURE;
    const lines = forceLimits(limits, contact);
    const end = 1.06 * Math.max(curve.length ? curve.at(-1)[0] : 0, ...lines.map(([, force]) => force), 1);
    const x = (force) => left + ((width - left - right) * force) / end;
    const y = (p) => top + ((height - top - bottom) * -Math.log10(Math.max(p, 10 ** -decades))) / decades;
    const label = "Probability of a higher peak force against the force, with the limits";
    const out = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": label });
    for (const force of roundNumbers(end)) {
        out.append(svg("line", { class: "grid", x1: x(force), x2: x(force), y1: top, y2: height - bottom }));
        out.append(svg("text", { x: x(force), y: height - bottom + 17, "text-anchor": "middle" }, general(force)));
    }
    for (let k = 0; k <= decades; k += 3) {
        const at = y(10 ** -k);
        out.append(svg("line", { class: "grid", x1: left, x2: width - right, y1: at, y2: at }));
        out.append(svg("text", { x: left - 6, y: at + 4, "text-anchor": "end" }, k ? `1e-${k}` : "1"));
    }
    const accepted = y(told.verdict.accepted_probability);
    out.append(svg("line", { class: "accepted", x1: left, x2: width - right, y1: accepted, y2: accepted }));
    out.append(svg("text", { x: left + 4, y: accepted - 4 }, "accepted"));
    lines.forEach(([name, force], k) => {
        out.append(svg("line", { class: "limit", x1: x(force), x2: x(force), y1: top, y2: height - bottom }));
        // Along the line: two that lie close together are named to the left and to the right.
        const place = `translate(${x(force) + (k ? 14 : -5)} ${height - bottom - 8}) rotate(-90)`;
        out.append(svg("text", { transform: place }, name));
    });
    const points = curve.map(([force, p]) => `${x(force).toFixed(2)},${y(p).toFixed(2)}`);
    out.append(svg("polyline", { class: "curve", points: points.join(" ") }));
    const middle = (left + width - right) / 2;
    out.append(svg("text", { x: middle, y: height - 6, "text-anchor": "middle" }, "peak force, N"));
    const turned = { transform: `translate(13 ${(top + height - bottom) / 2}) rotate(-90)`, "text-anchor": "middle" };
    out.append(svg("text", turned, "probability of a higher one"));
    return out;
}
