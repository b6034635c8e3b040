/**
 * The life of the live connection as a pure state machine: what happened in, what to do next out.
 *
 * It never gives up, and reconnecting commands nothing: the only thing that is ever sent is a ping.
 */

type Phase = "connecting" | "open" | "waiting";

export interface Link {
  readonly phase: Phase;
  /** Connections that failed or ended since the last good one. */
  readonly failures: number;
  /** When anything last arrived, null before the first message ever. */
  readonly received_ms: number | null;
  /** When to try again, while waiting. */
  readonly retry_ms: number;
  /** Time of the last ping there and back. */
  readonly latency_ms: number | null;
  readonly pinged_ms: number;
  readonly opened_ms: number;
  /** Time of the last look at the clock. */
  readonly checked_ms: number;
  /** Until when this page itself was asleep: silence before that says nothing about the link. */
  readonly awake_ms: number;
}

export type LinkEvent =
  | { readonly kind: "opened" }
  | { readonly kind: "heard" }
  | { readonly kind: "pong"; readonly sent_ms: number }
  | { readonly kind: "closed" }
  | { readonly kind: "wake" }
  | { readonly kind: "clock" };

type LinkAction = "none" | "connect" | "ping" | "drop";

export type Health = "live" | "stale" | "down";

const PING_EVERY_MS = 1000;
/** An open connection that is silent for this long is dropped and made anew. */
const SILENCE_MS = 3000;
const CONNECT_WITHIN_MS = 5000;
/** A look at the clock that comes this much later than the one before was held up by the browser. */
const ASLEEP_MS = 1000;
const STALE_AFTER_MS = 1000;
const FIRST_RETRY_MS = 250;
const LAST_RETRY_MS = 4000;

/** The state in which a page starts: a connection is being made. */
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

/** The next state and the one thing to do. */
export function step(link: Link, event: LinkEvent, now_ms: number): [Link, LinkAction] {
  switch (event.kind) {
    case "opened":
      return [{ ...link, phase: "open", received_ms: now_ms, opened_ms: now_ms, pinged_ms: now_ms }, "ping"];
    case "heard":
      return [{ ...link, failures: 0, received_ms: now_ms }, "none"];
    case "pong":
      return [{ ...link, failures: 0, received_ms: now_ms, latency_ms: now_ms - event.sent_ms }, "none"];
    case "closed":
      return [waiting(link, now_ms), "none"];
    case "wake":
      return link.phase === "waiting" ? [connecting(link, now_ms), "connect"] : [link, "none"];
    case "clock":
      return onClock(looked(link, now_ms), now_ms);
  }
}

function looked(link: Link, now_ms: number): Link {
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

/** How old the newest message is, or null when none ever came. */
export function age_ms(link: Link, now_ms: number): number | null {
  return link.received_ms === null ? null : Math.max(0, now_ms - link.received_ms);
}

/** Whether what the page shows may be trusted. */
export function health(link: Link, now_ms: number): Health {
  const age = age_ms(link, now_ms);
  if (age === null || link.phase !== "open") return "down";
  return age > STALE_AFTER_MS ? "stale" : "live";
}
