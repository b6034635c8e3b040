/**
 * Pure state machine of the live connection: each event yields the next state and one action.
 *
 * The machine retries without limit. Reconnecting sends no command: the only message sent is a ping.
 */

type Phase = "connecting" | "open" | "waiting";

export interface Link {
  readonly phase: Phase;
  /** Connections that failed or ended since the last message. */
  readonly failures: number;
  /** Time of the last message; null before the first one. */
  readonly received_ms: number | null;
  /** Time of the next attempt, in phase `waiting`. */
  readonly retry_ms: number;
  /** Round-trip time of the last ping. */
  readonly latency_ms: number | null;
  readonly pinged_ms: number;
  readonly opened_ms: number;
  /** Time of the last clock event. */
  readonly checked_ms: number;
  /** Time at which the page last resumed after a suspension; silence before it does not count. */
  readonly awake_ms: number;
}

export type LinkEvent =
  | { readonly kind: "opened" }
  | { readonly kind: "received" }
  | { readonly kind: "pong"; readonly sent_ms: number }
  | { readonly kind: "closed" }
  | { readonly kind: "wake" }
  | { readonly kind: "clock" };

type LinkAction = "none" | "connect" | "ping" | "drop";

export type Health = "live" | "stale" | "down";

const PING_EVERY_MS = 1000;
/** Silence after which an open connection is closed and retried. */
const SILENCE_MS = 3000;
const CONNECT_WITHIN_MS = 5000;
/** Delay between two clock events that shows that the browser suspended the page. */
const ASLEEP_MS = 1000;
const STALE_AFTER_MS = 1000;
const FIRST_RETRY_MS = 250;
const LAST_RETRY_MS = 4000;

/** Initial state of a page: connecting. */
export function firstLink(now_ms: number): Link {
  return {
    phase: "connecting",
    failures: 0,
    received_ms: null,
    retry_ms: now_ms,
    latency_ms: null,
    pinged_ms: now_ms,
    opened_ms: now_ms,
    checked_ms: now_ms,
    awake_ms: now_ms,
  };
}

/** Returns the next state and the action to take. */
export function step(link: Link, event: LinkEvent, now_ms: number): [Link, LinkAction] {
  switch (event.kind) {
    case "opened":
      return [{ ...link, phase: "open", received_ms: now_ms, opened_ms: now_ms, pinged_ms: now_ms }, "ping"];
    case "received":
      return [{ ...link, failures: 0, received_ms: now_ms }, "none"];
    case "pong":
      return [{ ...link, failures: 0, received_ms: now_ms, latency_ms: now_ms - event.sent_ms }, "none"];
    case "closed":
      return [waiting(link, now_ms), "none"];
    case "wake":
      return link.phase === "waiting" ? [connecting(link, now_ms), "connect"] : [link, "none"];
    case "clock":
      return onClock(checkClock(link, now_ms), now_ms);
  }
}

function checkClock(link: Link, now_ms: number): Link {
  const asleep = now_ms - link.checked_ms > ASLEEP_MS;
  return { ...link, checked_ms: now_ms, awake_ms: asleep ? now_ms : link.awake_ms };
}

function onClock(link: Link, now_ms: number): [Link, LinkAction] {
  if (link.phase === "waiting") {
    return now_ms >= link.retry_ms ? [connecting(link, now_ms), "connect"] : [link, "none"];
  }
  const last_ms = link.phase === "open" ? (link.received_ms ?? link.opened_ms) : link.opened_ms;
  const quiet_ms = now_ms - Math.max(last_ms, link.awake_ms);
  if (quiet_ms > (link.phase === "open" ? SILENCE_MS : CONNECT_WITHIN_MS))
    return [waiting(link, now_ms), "drop"];
  if (link.phase === "open" && now_ms - link.pinged_ms >= PING_EVERY_MS) {
    return [{ ...link, pinged_ms: now_ms }, "ping"];
  }
  return [link, "none"];
}

function connecting(link: Link, now_ms: number): Link {
  return { ...link, phase: "connecting", opened_ms: now_ms };
}

function waiting(link: Link, now_ms: number): Link {
  const delay_ms = Math.min(FIRST_RETRY_MS * 2 ** link.failures, LAST_RETRY_MS);
  return {
    ...link,
    phase: "waiting",
    failures: link.failures + 1,
    latency_ms: null,
    retry_ms: now_ms + delay_ms,
  };
}

/** Age of the newest message; null before the first one. */
export function age_ms(link: Link, now_ms: number): number | null {
  return link.received_ms === null ? null : Math.max(0, now_ms - link.received_ms);
}

/** Health of the connection, from its phase and the age of the newest message. */
export function health(link: Link, now_ms: number): Health {
  const age = age_ms(link, now_ms);
  if (age === null || link.phase !== "open") return "down";
  return age > STALE_AFTER_MS ? "stale" : "live";
}
