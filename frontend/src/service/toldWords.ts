/** The words of notifications, from what the service says by type. Pure. */

import { type Angles, inWords } from "../samples/quantity";
import { heading, inWordsOf } from "../samples/words";
import type { Fault, Run } from "../wire/types";
import type { Trip } from "./happenings";
import type { Allowed, LocalizedText } from "./notifications";

type Words = Omit<LocalizedText, "open">;

/** A run that is over: its kind, its number, how it ended; what it was, and why it ended so. */
export function wordsOfRun({ id, kind, title, end_state, end_reason }: Run, angles: Angles): Words {
  const more = end_state === "completed" ? [title] : [title, end_reason];
  return {
    tag: `sinew-run-${id}`,
    title: `${heading(kind)}, run ${id}: ${inWordsOf(end_state)}`,
    body: inWords(more.filter((part) => part !== "").join(" · "), angles),
  };
}

const STOP: Fault["code"] = "stop_pressed";

/** A trip, with its cause and what to do. Somebody who presses STOP makes no trip of it in words. */
export function wordsOfTrip({ fault, starts }: Trip, angles: Angles): Words {
  return {
    tag: `sinew-trip-${starts}-${fault.tick}`,
    title: fault.code === STOP ? "Stopped" : `Tripped: ${inWordsOf(fault.code)}`,
    body: inWords(`${fault.message} ${fault.remedy}`, angles),
  };
}

const WHY_NOT: Readonly<Record<Allowed, string>> = {
  granted: "",
  default: "This browser has not allowed notifications of this page yet: switch on here, and allow it.",
  denied:
    "This browser refuses notifications of this page. Allow them in its settings for this site, beside the address, then switch on here again.",
  insecure:
    "Browsers show notifications only of pages over HTTPS, or on the machine of the service itself: open the page there, or have it served over HTTPS.",
  missing: "This browser has no notifications: use another one, or the sound.",
};

/** What keeps notifications from being shown here, and what to do; "" where nothing does. */
export function whyNotTold(allowed: Allowed): string {
  return WHY_NOT[allowed];
}
