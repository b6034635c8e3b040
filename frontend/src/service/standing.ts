/** How long a refusal stands: each has a cause, and the message goes when its cause does. Pure. */

import type { Live } from "../live/store";
import { RequestError } from "../wire/client";

/** What a refusal is about, and so what ends it. */
type Cause = "control" | "link" | "moment" | "value";

/** A refusal with the circumstances in which it was given. */
export interface Standing {
  readonly error: Error | null;
  readonly circumstances: string;
  readonly since_ms: number;
  readonly over: boolean;
}

export const NOTHING: Standing = { error: null, circumstances: "", since_ms: 0, over: true };

/** The state that belongs to a refusal may come after it; what changes by then is no end. */
const SETTLE_MS = 600;

/** Whether a request was refused for who holds control: taking control is the remedy. */
export function isAboutControl(error: Error | null): boolean {
  return error instanceof RequestError && error.problem?.code.startsWith("control_") === true;
}

function causeOf(error: Error): Cause {
  if (!(error instanceof RequestError)) return "value";
  if (error.status === 0) return "link";
  if (isAboutControl(error)) return "control";
  return error.status === 409 || error.status === 503 ? "moment" : "value";
}

/**
 * What has to stay as it is for the refusal to hold. `epoch` is the control that this page holds, `about` what the
 * refused request would have changed, as it is in force.
 */
export function circumstances(error: Error, live: Live, epoch: number | null, about: unknown): string {
  const { state, link } = live;
  switch (causeOf(error)) {
    case "control":
      return JSON.stringify([epoch, state?.holder?.epoch]);
    case "link":
      return JSON.stringify([link.opened_ms, about]);
    case "moment":
      return JSON.stringify([
        state?.mode,
        state?.fault?.code,
        state?.task?.run,
        state?.trial === null,
        state?.pretension_done,
        state?.link.starts,
        about,
      ]);
    case "value":
      return JSON.stringify(about ?? null);
  }
}

/** The refusal as it stands now; one that is over does not come back, whatever returns. */
export function stands(before: Standing, error: Error | null, now: string, now_ms: number): Standing {
  if (error !== before.error) return { error, circumstances: now, since_ms: now_ms, over: error === null };
  if (before.over || now === before.circumstances) return before;
  if (now_ms - before.since_ms < SETTLE_MS) return { ...before, circumstances: now };
  return { ...before, over: true };
}
