/** Fills the page, or exports what tests use where there is none. */
function begin_page(load) {
    if (typeof document === "undefined") {
        module.exports = { load, check, evaluate, readToml, general, percent, smallPercent, decimal, Refusal };
        return;
    }
}
