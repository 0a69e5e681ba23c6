// Numbers and probabilities as the command writes them.

/** A number with so many significant digits, as %g of C. */
function general(x, digits = 6) {
    if (!Number.isFinite(x)) return Number.isNaN(x) ? "nan" : x > 0 ? "inf" : "-inf";
    if (x === 0) return Object.is(x, -0) ? "-0" : "0";
    const [mantissa, power] = x.toExponential(digits - 1).split("e");
    const exponent = Number(power);
    const bare = (text) => (text.includes(".") ? text.replace(/\.?0+$/, "") : text);
    if (exponent >= -4 && exponent < digits) return bare(x.toFixed(Math.max(0, digits - 1 - exponent)));
    return `${bare(mantissa)}e${exponent < 0 ? "-" : "+"}${String(Math.abs(exponent)).padStart(2, "0")}`;
}

/** A power of ten with an exponent of two digits at least. */
function scientific(x, digits) {
    return x.toExponential(digits).replace(/e([+-])(\d)$/, "e$10$2");
}

/** A probability in percent; an integrated one never rounds to certainty, nor to impossibility. */
function percent(p, integrated = false) {
    const least = DATA.numbers.min_percent;
    if (Number.isNaN(p)) return "none";
    if (p >= 1 && !integrated) return "100 %";
    if (p <= 0 && !integrated) return "0 %";
    if (p < least) return `less than ${(100 * least).toFixed(4)} %`;
    if (p > 1 - least) return "over 99.9999 %";
    if (p < 0.1) return `${general(Number((100 * p).toPrecision(2)), 7)} %`;
    return p <= 0.999 ? `${general(100 * p, 3)} %` : `${general(Math.floor(1e6 * p) / 1e4)} %`;
}

/** The same with figures for what is next to nothing. */
function smallPercent(p, integrated = false) {
    if (!(p < DATA.numbers.min_percent) || (p <= 0 && !integrated)) return percent(p, integrated);
    return p > 0 ? `${general(100 * p, 2)} %` : `less than ${scientific(100 * DATA.numbers.min_printed, 0)} %`;
}

/** What is accepted, in percent with all of its digits: others are compared with it. */
function acceptedPercent(p) {
    return `${general(100 * p, 10)} %`;
}

/** A probability as `text` tells it, on its side of what is accepted as acceptedPercent tells that. */
function apart(p, accepted, text) {
    const told = text(p, true);
    if (!/^[0-9]/.test(told)) return told;
    if (p === accepted) return acceptedPercent(accepted);
    const beside = parseFloat(acceptedPercent(accepted));
    const tells = (one) => (p > accepted ? parseFloat(one) > beside : parseFloat(one) < beside);
    for (let digits = 2, one = told; digits < 18; one = `${general(100 * p, ++digits)} %`) if (tells(one)) return one;
    return told;
}

/** An integrated probability in a column. */
function decimal(p) {
    if (p >= 0.001) return p.toFixed(4);
    const least = DATA.numbers.min_printed;
    return p > least ? scientific(p, 1) : `< ${scientific(least, 0)}`;
}

/** Four significant digits; what is below a millionth is rounding. */
function figure(x) {
    return Math.abs(x) < 1e-6 ? "0" : general(x, 4);
}
