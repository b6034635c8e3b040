/** Sending STOP: at once, whatever the link looks like, tried a few times, and honest about what came back. */

import type { StopProof } from "../wire/types";

export type StopState =
  | { readonly kind: "idle" }
  | { readonly kind: "sending" }
  | { readonly kind: "confirmed"; readonly proof: StopProof }
  | { readonly kind: "unconfirmed"; readonly reason: string };

const ATTEMPTS = 3;

/**
 * Ask for the stop until it is confirmed, at most three times. A refusal and a silent network end alike: not confirmed,
 * with the last reason.
 */
export async function sendStop(post: () => Promise<StopProof>): Promise<StopState> {
  let reason = "";
  for (let attempt = 0; attempt < ATTEMPTS; attempt++) {
    try {
      return { kind: "confirmed", proof: await post() };
    } catch (error) {
      reason = error instanceof Error ? error.message : String(error);
    }
  }
  return { kind: "unconfirmed", reason };
}

/** True for the one key combination that stops. */
export function isStopKey(event: Pick<KeyboardEvent, "ctrlKey" | "metaKey" | "shiftKey" | "code">): boolean {
  return (event.ctrlKey || event.metaKey) && event.shiftKey && event.code === "KeyE";
}
