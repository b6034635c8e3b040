/** What the log can be narrowed to, in words. Pure. */

import type { LogKind } from "../../service/log";

/** Each kind by its name; a new kind of the service has to be given one here. */
export const NAMES: Readonly<Record<LogKind, string>> = {
  mode: "Mode",
  tuning: "Tuning",
  bank: "Bank",
  fault: "Fault",
  references: "References",
  note: "Note",
  trip: "Trip",
  trigger: "Trigger",
  run: "Run",
  recording: "Recording",
  retention: "Room for recordings",
  flight_quota: "Flight records",
  backup: "Backup",
  access: "Sign-in",
  refusal: "Refusal",
};

export const ALARMS: readonly LogKind[] = ["fault", "trip", "recording"];

/** What a choice of the box means: "" all, "alarms", or one kind. */
export function kindsOf(choice: string): readonly LogKind[] {
  if (choice === "alarms") return ALARMS;
  return isKind(choice) ? [choice] : [];
}

export const CHOICES = [
  { value: "", label: "everything" },
  { value: "alarms", label: "alarms: trips, faults, lost samples" },
  ...Object.entries(NAMES).map(([value, label]) => ({
    value,
    label: value === "refusal" ? "Refusals" : label,
  })),
];

/** Midnight at the begin of a day of the person's own zone, or `days` later, as the service has times; "" for none. */
export function midnight(day: string, days = 0): string {
  const begin = new Date(`${day}T00:00`);
  if (Number.isNaN(begin.getTime())) return "";
  begin.setDate(begin.getDate() + days);
  return begin.toISOString();
}

function isKind(choice: string): choice is LogKind {
  return choice in NAMES;
}
