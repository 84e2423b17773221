// Arrays of the page: base64 of little-endian doubles.
"use strict";

function numbersOf(text) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new Float64Array(bytes.buffer);
}
