// Reads a scenario file: the part of TOML that scenarios are written in. What it does not know it refuses; texts of several
// lines in quotes and dates are such.

/** Something that was written cannot be used: the field, what is wrong with it, and what would be valid. */
class Refusal extends Error {
    constructor(field, problem, valid = "") {
        super(`${field}: ${problem}${valid ? `; ${valid}` : ""}`);
        this.field = field;
    }
}

/** A number with a point or an exponent, apart from whole ones: some keys take only these. */
class Real {
    constructor(value) {
        this.value = value;
    }
}

/** Whether a value of a file is a table. */
function isTable(value) {
    return typeof value === "object" && !Array.isArray(value) && !(value instanceof Real);
}

const ESCAPES = { b: "\b", t: "\t", n: "\n", f: "\f", r: "\r", '"': '"', "\\": "\\" };

class TomlReader {
    constructor(text) {
        this.text = text;
        this.at = 0;
        this.defined = new Set(); // tables that may have no header any more
        this.closed = new Set(); // those in braces, to which nothing can be added
    }

    fail(problem) {
        const line = this.text.slice(0, this.at).split("\n").length;
        throw new Refusal(`line ${line}`, problem);
    }

    peek(pattern) {
        pattern.lastIndex = this.at;
        return pattern.exec(this.text);
    }

    take(pattern) {
        const found = this.peek(pattern);
        if (found) this.at = pattern.lastIndex;
        return found;
    }

    blanks() {
        this.take(/[ \t]*/y);
    }

    /** Blanks, comments and ends of lines. */
    nothing() {
        this.take(/(?:[ \t]|\r?\n|#[^\x00-\x08\x0a-\x1f\x7f]*)*/y);
    }

    end_of_line() {
        if (!this.take(/[ \t]*(?:#[^\x00-\x08\x0a-\x1f\x7f]*)?(?:\r?\n|$)/y)) this.fail("more than one value in a line");
    }

    read() {
        const root = Object.create(null);
        let table = root;
        for (this.nothing(); this.at < this.text.length; this.nothing()) {
            if (this.peek(/\[\[/y)) this.fail("[[...]] is no table of a scenario");
            if (this.take(/\[/y)) {
                this.blanks();
                const path = this.path();
                if (!this.take(/\]/y)) this.fail("a table's name ends with ]");
                table = this.table(root, path);
            } else {
                this.assign(table);
            }
            this.end_of_line();
        }
        return root;
    }

    table(root, path) {
        const name = path.join(".");
        let here = root;
        for (const key of path) {
            if (here[key] === undefined) here[key] = Object.create(null);
            here = here[key];
            if (!isTable(here) || this.closed.has(here)) this.fail(`${name} is no table, or a closed one`);
        }
        if (this.defined.has(here)) this.fail(`[${name}] stands twice`);
        this.defined.add(here);
        return here;
    }

    path() {
        const keys = [];
        do {
            this.blanks();
            const bare = this.take(/[A-Za-z0-9_-]+/y);
            keys.push(bare ? bare[0] : this.string());
            this.blanks();
        } while (this.take(/\./y));
        return keys;
    }

    assign(table) {
        const path = this.path();
        if (!this.take(/=/y)) this.fail(`${path.join(".")} has no = behind it`);
        this.blanks();
        const value = this.value();
        const last = path.pop();
        let here = table;
        for (const key of path) {
            if (here[key] === undefined) {
                here[key] = Object.create(null);
                this.defined.add(here[key]);
            }
            here = here[key];
            if (!isTable(here) || this.closed.has(here)) this.fail(`${key} is no table, or a closed one`);
        }
        if (here[last] !== undefined) this.fail(`${last} stands twice`);
        here[last] = value;
    }

    value() {
        if (this.peek(/"""|'''/y)) this.fail("this page reads no texts of several lines");
        if (this.peek(/["']/y)) return this.string();
        if (this.take(/\[/y)) return this.list();
        if (this.take(/\{/y)) return this.inline_table();
        const word = this.take(/[A-Za-z0-9_+.:-]+/y);
        if (!word) this.fail("no value, or one that this page cannot read");
        return this.scalar(word[0]);
    }

    string() {
        if (this.take(/'/y)) {
            const found = this.take(/([^'\x00-\x08\x0a-\x1f\x7f]*)'/y);
            return found ? found[1] : this.fail("a text without its closing '");
        }
        if (!this.take(/"/y)) this.fail("no key, or one that this page cannot read");
        const found = this.take(/((?:[^"\\\x00-\x08\x0a-\x1f\x7f]|\\.)*)"/y);
        if (!found) this.fail('a text without its closing "');
        return found[1].replace(/\\(u[0-9A-Fa-f]{4}|.)/g, (_, escape) => {
            if (escape.length > 1) return String.fromCharCode(parseInt(escape.slice(1), 16));
            return ESCAPES[escape] ?? this.fail(`\\${escape} is no character that this page reads`);
        });
    }

    list() {
        const items = [];
        for (this.nothing(); !this.take(/\]/y); this.nothing()) {
            items.push(this.value());
            this.nothing();
            if (!this.take(/,/y) && !this.peek(/\]/y)) this.fail("a list without its closing ]");
        }
        return items;
    }

    inline_table() {
        const table = Object.create(null);
        this.blanks();
        if (!this.take(/\}/y)) {
            do {
                this.assign(table);
                this.blanks();
            } while (this.take(/,/y));
            if (!this.take(/\}/y)) this.fail("a table without its closing }");
        }
        this.closed.add(table);
        return table;
    }

    scalar(word) {
        if (word === "true" || word === "false") return word === "true";
        if (/^[+-]?(?:0|[1-9](?:_?\d)*)$/.test(word)) {
            const whole = Number(word.replaceAll("_", ""));
            return Number.isSafeInteger(whole) ? whole : this.fail(`${word} has more digits than a number of a scenario`);
        }
        const special = /^([+-]?)(inf|nan)$/.exec(word);
        if (special) return new Real(special[2] === "nan" ? NaN : special[1] === "-" ? -Infinity : Infinity);
        if (/^[+-]?(?:0|[1-9](?:_?\d)*)(?:\.\d(?:_?\d)*)?(?:[eE][+-]?\d(?:_?\d)*)?$/.test(word))
            return new Real(Number(word.replaceAll("_", "")));
        return this.fail(`${word} cannot be used: a text stands in quotes`);
    }
}

/** The tables and keys of a scenario file, not checked yet. */
function readToml(text) {
    return new TomlReader(text).read();
}
