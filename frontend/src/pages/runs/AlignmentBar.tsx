/** Which run the others are compared with, and what of each is brought to one moment. */

import { NativeSelect } from "@mantine/core";
import type { ComparisonAsked } from "../../service/comparison";
import { NAMES } from "../log/kinds";
import page from "../Page.module.css";
import {
  ALIGN_BY,
  type AlignBy,
  type Compared,
  EVENT_KINDS,
  type EventKind,
  MOST_NUMBER,
  STEP_SIGNALS,
  type StepSignal,
} from "./compared";
import { SettledNumber } from "./SettledNumber";

const WORDS: Readonly<Record<AlignBy, string>> = {
  begin: "the begin of each run",
  step: "a step",
  event: "an event of the log",
};
const STEPS: Readonly<Record<StepSignal, string>> = {
  q_ref: "of q_ref",
  S_ref: "of S_ref",
  F_push: "of the push F_push",
};

interface AlignmentBarProps {
  readonly asked: ComparisonAsked;
  onChange(to: Partial<Compared>): void;
}

export function AlignmentBar({ asked, onChange }: AlignmentBarProps) {
  const { run, reference, by, step, event, number } = asked;
  return (
    <div className={page.actions}>
      <NativeSelect
        aria-label="Reference"
        value={String(reference)}
        data={run.map((id) => ({ value: String(id), label: `reference: run ${id}` }))}
        onChange={({ currentTarget: { value } }) =>
          onChange({ reference: Number(value) === run[0] ? null : Number(value) })
        }
      />
      <NativeSelect
        aria-label="Align by"
        value={by}
        data={ALIGN_BY.map((value) => ({ value, label: `aligned by ${WORDS[value]}` }))}
        onChange={({ currentTarget: { value } }) => onChange({ by: value as AlignBy, number: 1 })}
      />
      {by === "step" && (
        <NativeSelect
          aria-label="Step of"
          value={step}
          data={STEP_SIGNALS.map((value) => ({ value, label: STEPS[value] }))}
          onChange={({ currentTarget: { value } }) => onChange({ step: value as StepSignal })}
        />
      )}
      {by === "event" && (
        <NativeSelect
          aria-label="Kind of event"
          value={event}
          data={EVENT_KINDS.map((value) => ({ value, label: NAMES[value] }))}
          onChange={({ currentTarget: { value } }) => onChange({ event: value as EventKind })}
        />
      )}
      {by !== "begin" && (
        <SettledNumber
          label={by === "step" ? "Number of the step" : "Number of the event"}
          before="no."
          value={number}
          fits={(found) =>
            Number.isInteger(found) && found >= 1 && found <= MOST_NUMBER ? "" : "is a whole number from 1 on"
          }
          onChange={(found) => onChange({ number: found ?? 1 })}
        />
      )}
    </div>
  );
}
