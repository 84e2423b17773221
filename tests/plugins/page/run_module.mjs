// Simulate with a page's module: node run_module.mjs MODULE SETTINGS.json NUMBERS.bin OUT.bin
// NUMBERS.bin: theta, then the inputs of the steps; OUT.bin: figures, mass injected after every step, channels.
import { readFileSync, writeFileSync } from "node:fs";

const [module, settings, numbers, out] = process.argv.slice(2);
const s = JSON.parse(readFileSync(settings, "utf8")), bytes = readFileSync(numbers);
const given = new Float64Array(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length));
const { instance } = await WebAssembly.instantiate(readFileSync(module), {});
const m = instance.exports, array = (place, length) => new Float64Array(m.memory.buffer, place, length);
array(m.theta(), s.columns).set(given.subarray(0, s.columns));
array(m.inputs(), 6 * s.steps).set(given.subarray(s.columns));
const taken = m.simulate(s.steps, 1, 1, s.ring, s.steps, 0, s.dt, s.rail, s.cylinder, s.low);
if (taken !== s.steps) throw new Error(`${taken} steps were simulated, not ${s.steps}`);
const found = [array(m.figures(), s.figures), array(m.injected(), s.steps + 1), array(m.channels(), (s.steps + 1) * s.channels)];
writeFileSync(out, Buffer.concat(found.map((a) => Buffer.from(a.buffer, a.byteOffset, a.byteLength))));
