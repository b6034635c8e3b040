import { ActionIcon, Button, TextInput } from "@mantine/core";
import { Fragment, useEffect, useMemo, useRef, useState } from "react";
import { TbPlus, TbX } from "react-icons/tb";
import { ChoiceField, NumberField } from "../../components/fields";
import { duration, notANumber } from "../../samples/format";
import { labelWith } from "../../samples/quantity";
import { useAngleUnit } from "../../service/api/preferences";
import { useRefusedInput, useRefusedWithin } from "../../service/forms/refusals";
import { symbolEntry } from "../../service/glossary";
import type { PartPlayed } from "../../wire/types";
import pageStyles from "../Page.module.css";
import {
  beside,
  type Document,
  inserted,
  moved,
  numberOf,
  type Part,
  type Place,
  removed,
  replaced,
} from "./document";
import { type Composing, PartList } from "./PartList";
import segmentsEditorStyles from "./SegmentsEditor.module.css";
import sequenceEditorStyles from "./SequenceEditor.module.css";

/** The sequence of an experiment, part by part: by drag, by keyboard, in loops as deep as they go. */

interface SequenceEditorProps {
  readonly document: Document;
  /** What the service has laid out of it; none while that is of another text. */
  readonly played: readonly PartPlayed[];
  onChange(document: Document): void;
}

export function SequenceEditor({ document, played, onChange }: SequenceEditorProps) {
  const box = useRef<HTMLDivElement>(null);
  const dragged = useRef<Place | null>(null);
  const [focus, setFocus] = useState<{ readonly place: Place; readonly button: string } | null>(null);
  const [told, tell] = useState("");
  useEffect(() => {
    if (focus === null) return;
    const row = box.current?.querySelector(`[data-place="${focus.place.join(".")}"]`);
    row?.querySelector<HTMLElement>(`[data-button="${focus.button}"]`)?.focus();
    setFocus(null);
  }, [focus]);
  const byPlace = useMemo(() => new Map(played.map((part) => [part.path.join("."), part])), [played]);

  function move(from: Place, to: Place, button: string | null): void {
    const [next, where] = moved(document, from, to);
    onChange(next);
    tell(`Part ${numberOf(from)} is part ${numberOf(where)} now.`);
    if (button !== null) setFocus({ place: where, button });
  }

  const composing: Composing = {
    played: byPlace,
    replace: (place, part) => onChange(replaced(document, place, part)),
    insert: (place, part) => onChange(inserted(document, place, part)),
    remove: (place) => onChange(removed(document, place)),
    canShift: (place, by) => beside(document, place, by) !== null,
    shift: (place, by) => {
      const to = beside(document, place, by);
      if (to !== null) move(place, to, by > 0 ? "down" : "up");
    },
    drag: (from, event) => {
      dragged.current = from;
      event.stopPropagation();
      event.dataTransfer.effectAllowed = "move";
      event.dataTransfer.setData("text/plain", numberOf(from));
    },
    drop: (before) => {
      if (dragged.current !== null) move(dragged.current, before, null);
      dragged.current = null;
    },
  };

  return (
    <div className={pageStyles.fields} ref={box}>
      <div className={pageStyles.actions}>
        <Text
          label="Name"
          place="name"
          value={document.name}
          onChange={(name) => onChange({ ...document, name })}
        />
        <Text
          label="Title"
          place="title"
          value={document.title}
          onChange={(title) => onChange({ ...document, title })}
        />
      </div>
      {document.phases.map((phase, index) => (
        <fieldset key={phase.name} className={sequenceEditorStyles.phase}>
          <legend>
            {index + 1} {phase.title}
          </legend>
          <PartList
            place={["phases", index, "parts"]}
            parts={phase.parts as readonly Part[]}
            composing={composing}
          />
        </fieldset>
      ))}
      <output className={sequenceEditorStyles.unseen} aria-label="Moved">
        {told}
      </output>
    </div>
  );
}

interface TextProps {
  readonly label: string;
  readonly place: string;
  readonly value: string;
  onChange(value: string): void;
}

function Text({ label, place, value, onChange }: TextProps) {
  const { ref, said } = useRefusedInput<HTMLInputElement>(place);
  return (
    <TextInput
      ref={ref}
      size="xs"
      label={label}
      value={value}
      error={said}
      inputWrapperOrder={["label", "input", "description", "error"]}
      onChange={(event) => onChange(event.currentTarget.value)}
    />
  );
}

/** Own sequences of references as rows of an editor, in SI. Pure. */

const SHAPES = ["step", "ramp", "sine"] as const;

/** Text stands for what was typed and is no number: it is shown, and never sent. */
type Typed = number | string;

export interface Segment {
  readonly shape: (typeof SHAPES)[number];
  readonly duration_s: Typed;
  readonly q_ref: Typed;
  readonly S_ref: Typed;
  readonly F_push: Typed;
  /** Of a sine. */
  readonly period_s: Typed;
}

const NEW: Segment = { shape: "step", duration_s: 4, q_ref: 0, S_ref: 10, F_push: 0, period_s: 2 };

const NAMES = {
  duration_s: "time",
  q_ref: "q_ref",
  S_ref: "S_ref",
  F_push: "push",
  period_s: "period",
} as const;

/** Rows of a JSON list of segments; null when it is none. */
export function parseSegments(json: string): Segment[] | null {
  try {
    const items: unknown = JSON.parse(json);
    return Array.isArray(items) ? items.map(segmentOf) : null;
  } catch {
    return null;
  }
}

export function writeSegments(segments: readonly Segment[]): string {
  const items = segments.map(({ shape, duration_s, q_ref, S_ref, F_push, period_s }) => ({
    duration_s,
    q_ref,
    S_ref,
    ...(F_push === 0 ? {} : { F_push }),
    ...(shape === "step" ? {} : { shape }),
    ...(shape === "sine" ? { period_s } : {}),
  }));
  return JSON.stringify(items);
}

/** Why these segments cannot be sent: the first box that holds no number; null when all do, or there are none. */
export function segmentsProblem(json: unknown): string | null {
  for (const [index, segment] of (typeof json === "string" ? (parseSegments(json) ?? []) : []).entries()) {
    const problem = segmentProblem(segment);
    if (problem !== null) return `Segment ${index + 1}, ${problem}.`;
  }
  return null;
}

/** The first box of a segment that holds no number, and what it holds; null when all do. */
function segmentProblem(segment: Segment): string | null {
  for (const [name, words] of Object.entries(NAMES)) {
    const value = segment[name as keyof typeof NAMES];
    if (typeof value === "string") return `${words}: ${notANumber(value)}`;
  }
  return null;
}

/** Length of all segments [s], of those that say one. */
export function totalOf(segments: readonly Segment[]): number {
  return segments.reduce((sum, { duration_s }) => sum + (typeof duration_s === "number" ? duration_s : 0), 0);
}

/** A further segment like the last one. */
export function further(segments: readonly Segment[]): Segment {
  return segments.at(-1) ?? NEW;
}

function segmentOf(item: Record<string, number | string>): Segment {
  const typed = (name: string, otherwise: number): Typed => item[name] ?? otherwise;
  return {
    shape: SHAPES.find((shape) => shape === item.shape) ?? "step",
    duration_s: typed("duration_s", 4),
    q_ref: typed("q_ref", 0),
    S_ref: typed("S_ref", 10),
    F_push: typed("F_push", 0),
    period_s: typed("period_s", 2),
  };
}

/** Own sequence of references, one row per segment. */

const COLUMNS = [
  { name: "duration_s", words: "Time", unit: "s" },
  { name: "q_ref", words: "q_ref", unit: "rad" },
  { name: "S_ref", words: "S_ref", unit: "N·m/rad" },
  { name: "F_push", words: "Push", unit: "N" },
  { name: "period_s", words: "Period", unit: "s" },
] as const;

interface SegmentsEditorProps {
  readonly json: string;
  onChange(json: string): void;
}

export function SegmentsEditor({ json, onChange }: SegmentsEditorProps) {
  const angles = useAngleUnit();
  const segments = parseSegments(json) ?? [];
  const send = (rows: readonly Segment[]) => onChange(writeSegments(rows));
  const total_s = totalOf(segments);

  return (
    <fieldset className={segmentsEditorStyles.editor}>
      <legend>Segments, {duration(total_s)}</legend>
      <div className={segmentsEditorStyles.row} aria-hidden="true">
        <span>Shape</span>
        {COLUMNS.map(({ name, words, unit }) => (
          <span key={name}>{labelWith(words, unit, angles)}</span>
        ))}
      </div>
      {segments.map((segment, index) => (
        // biome-ignore lint/suspicious/noArrayIndexKey: a segment is its place in the sequence
        <Fragment key={index}>
          <div className={segmentsEditorStyles.row}>
            <ChoiceField
              aria-label={`Shape of segment ${index + 1}`}
              data={[...SHAPES]}
              value={segment.shape}
              place={`segments.${index}.shape`}
              messageId={`segment-${index}-refused`}
              onChange={(shape) =>
                send(segments.with(index, { ...segment, shape: shape as Segment["shape"] }))
              }
            />
            {COLUMNS.map(({ name, words, unit }) => (
              <NumberField
                key={name}
                aria-label={`${labelWith(words, unit, angles)} of segment ${index + 1}`}
                unit={unit}
                entry={symbolEntry(name)}
                place={`segments.${index}.${name}`}
                messageId={`segment-${index}-refused`}
                disabled={name === "period_s" && segment.shape !== "sine"}
                value={segment[name]}
                onChange={(value) => send(segments.with(index, { ...segment, [name]: value }))}
              />
            ))}
            <ActionIcon
              variant="subtle"
              color="gray"
              aria-label={`Remove segment ${index + 1}`}
              disabled={segments.length === 1}
              onClick={() => send(segments.toSpliced(index, 1))}
            >
              <TbX size={14} />
            </ActionIcon>
          </div>
          <RowRefusal index={index} problem={segmentProblem(segment)} />
        </Fragment>
      ))}
      <Button
        variant="default"
        size="compact-xs"
        leftSection={<TbPlus size={13} />}
        onClick={() => send([...segments, further(segments)])}
      >
        Add segment
      </Button>
    </fieldset>
  );
}

/** Below the row, as the boxes are too narrow for a sentence. */
function RowRefusal({ index, problem }: { index: number; problem: string | null }) {
  const refused = useRefusedWithin(`segments.${index}`);
  const said = problem ?? refused;
  return said === null ? null : (
    <div id={`segment-${index}-refused`} role="alert" className={segmentsEditorStyles.refused}>
      {said}
    </div>
  );
}
