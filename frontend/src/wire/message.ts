/** The text messages of the live stream. */

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
