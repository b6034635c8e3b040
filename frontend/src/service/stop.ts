/** Sending STOP: at once, whatever the link looks like, tried a few times, and honest about what came back. */

import type { State, StopProof } from "../wire/types";

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

/**
 * What is left to say of a press once `state` came in after it. A stop that took place belongs to the service, which has
 * its proof until the reset; one that was not confirmed is over when the loop itself says that the motors rest.
 */
export function settled(
  stop: StopState,
  state: Pick<State, "mode" | "tick" | "stop_proof" | "link">,
): StopState {
  const resting = state.link.alive && (state.mode === "tripped" || state.mode === "off");
  const told =
    stop.kind === "confirmed"
      ? state.stop_proof?.arrived_tick === stop.proof.arrived_tick || state.tick >= stop.proof.zero_tick
      : stop.kind === "unconfirmed" && resting;
  return told ? { kind: "idle" } : stop;
}

/** True for the one key combination that stops. */
export function isStopKey(event: Pick<KeyboardEvent, "ctrlKey" | "metaKey" | "shiftKey" | "code">): boolean {
  return (event.ctrlKey || event.metaKey) && event.shiftKey && event.code === "KeyE";
}
