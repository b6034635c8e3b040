/** Decodes the messages of the live stream: texts, and binary frames of samples. Pure. */

import type { LiveMessage } from "./types";

const KINDS: ReadonlySet<string> = new Set<LiveMessage["type"]>(["layout", "state", "event", "pong"]);

/**
 * Parse a text message. Kinds that this page does not know are null: a newer service may add some.
 *
 * @throws SyntaxError when the text is not a JSON object with a type.
 */
export function parseMessage(text: string): LiveMessage | null {
  const value: unknown = JSON.parse(text);
  if (typeof value !== "object" || value === null || !("type" in value) || typeof value.type !== "string") {
    throw new SyntaxError("live message without a type");
  }
  return KINDS.has(value.type) ? (value as LiveMessage) : null;
}

/** The binary message of the live stream: a header, then one float32 column per stored signal. */

const HEADER_BYTES = 16;
const FLOAT_BYTES = 4;

export interface Frame {
  /** Index of the first sample. */
  readonly firstTick: number;
  readonly count: number;
  /** Samples the service dropped for this page just before this frame. */
  readonly missed: number;
  /** `count` values of each stored signal, in the order of the layout. */
  readonly columns: readonly Float32Array[];
}

/**
 * Decode a frame. The columns are views on the message, nothing is copied.
 *
 * @throws RangeError when the length does not fit the header and the number of signals.
 */
export function decodeFrame(message: ArrayBuffer, signals: number): Frame {
  if (message.byteLength < HEADER_BYTES) {
    throw new RangeError(
      `live frame of ${message.byteLength} bytes is shorter than its ${HEADER_BYTES}-byte header`,
    );
  }
  const header = new DataView(message, 0, HEADER_BYTES);
  const firstTick = Number(header.getBigUint64(0, true));
  const count = header.getUint32(8, true);
  const missed = header.getUint32(12, true);
  const expected = HEADER_BYTES + count * signals * FLOAT_BYTES;
  if (message.byteLength !== expected) {
    throw new RangeError(
      `live frame of ${count} × ${signals} values has ${message.byteLength} bytes, not ${expected}`,
    );
  }
  const columns = Array.from(
    { length: signals },
    (_, column) => new Float32Array(message, HEADER_BYTES + column * count * FLOAT_BYTES, count),
  );
  return { firstTick, count, missed, columns };
}
