// Who computes: a worker beside the page, which is ended where nobody wants its answer any more.

/** Answers texts with what is said of them, and then with the warning about steps, which takes longer. */
function serve(load) {
    const loaded = load();
    onmessage = async ({ data: { number, text } }) => {
        try {
            const core = await loaded;
            const began = performance.now();
            const found = evaluate(core, text);
            const { told, curve, problem } = found;
            const { robot, limits, scenario } = problem;
            const took = performance.now() - began;
            postMessage({ number, told, curve, took, title: robot.title, limits, contact: scenario.contact });
            postMessage({ number, coarse: finerStepsWarning(core, text, found), done: true });
        } catch (error) {
            const failed = !(error instanceof Refusal);
            postMessage({ number, failed, refused: failed ? `The computation failed: ${error}` : error.message, done: true });
        }
    };
}

/** Asks a worker, one text at a time; what is asked for meanwhile ends a work that is not about to be done. */
class Computation {
    /** `source` is the text of this script, `answer` is called with what the worker says. */
    constructor(source, answer) {
        this.address = URL.createObjectURL(new Blob([`(${source})();`], { type: "text/javascript" }));
        this.answer = answer;
        this.number = 0;
        this.start();
    }

    start() {
        this.worker = new Worker(this.address);
        this.busy = false;
        this.worker.onmessage = ({ data }) => {
            if (data.done) this.busy = false;
            // One that has failed cannot be trusted with the next text.
            if (data.failed) this.restart();
            if (data.number === this.number) this.answer(data);
        };
    }

    restart() {
        this.worker.terminate();
        this.start();
    }

    ask(text) {
        if (this.busy) this.restart();
        this.busy = true;
        this.number += 1;
        this.worker.postMessage({ number: this.number, text });
    }
}
