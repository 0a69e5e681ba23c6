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
            try {
                postMessage({ number, coarse: finerStepsWarning(core, text, found), done: true });
            } catch (error) {
                // Of memory, mostly: what was found before stands.
                const coarse = `Whether finer simulation steps hit harder could not be computed here (${error}).`;
                postMessage({ number, failed: true, coarse, done: true });
            }
        } catch (error) {
            const failed = !(error instanceof Refusal);
            postMessage({ number, failed, refused: failed ? `The computation failed: ${error}` : error.message, done: true });
        }
    };
}

// What is being computed when another text comes has so long to be done [ms].
const PATIENCE = 150;

/** Asks a worker about the latest text; one that is still busy with another is ended after a while. */
class Computation {
    /** `source` is the text of this script, `answer` is called with what the worker says. */
    constructor(source, answer) {
        this.address = URL.createObjectURL(new Blob([`(${source})();`], { type: "text/javascript" }));
        this.answer = answer;
        this.number = 0;
        this.next = null;
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
            if (!this.busy && this.next) this.send();
        };
    }

    interrupt() {
        this.waiting = null;
        if (this.next === null) return;
        this.restart();
        this.send();
    }

    restart() {
        this.worker.terminate();
        this.start();
    }

    ask(text) {
        this.number += 1;
        this.next = { number: this.number, text };
        if (!this.busy) this.send();
        else this.waiting ??= setTimeout(() => this.interrupt(), PATIENCE);
    }

    /** No answer is wanted any more. */
    forget() {
        this.number += 1;
        this.next = null;
    }

    send() {
        clearTimeout(this.waiting);
        this.waiting = null;
        this.busy = true;
        this.worker.postMessage(this.next);
        this.next = null;
    }
}
