import { TextInput } from "@mantine/core";
import { useEffect, useMemo, useRef, useState } from "react";
import { fillText } from "../../samples/texts";
import { useRefusedInput } from "../../service/forms/refusals";
import type { PartPlayed } from "../../wire/types";
import pageStyles from "../Page.module.css";
import {
  type Document,
  inserted,
  moved,
  neighbour,
  numberOf,
  type Part,
  type Place,
  removed,
  replaced,
} from "./document";
import { type Composing, PartList } from "./PartList";
import sequenceEditorStyles from "./SequenceEditor.module.css";
import { TEXTS } from "./texts";

interface SequenceEditorProps {
  readonly document: Document;
  /** Schedule that the service computed; empty while it belongs to another text. */
  readonly played: readonly PartPlayed[];
  onChange(document: Document): void;
}

/** Editor of the sequence of an experiment; moves parts by drag and by keyboard, also into nested loops. */
export function SequenceEditor({ document, played, onChange }: SequenceEditorProps) {
  const box = useRef<HTMLDivElement>(null);
  const dragged = useRef<Place | null>(null);
  const [focus, setFocus] = useState<{ readonly place: Place; readonly button: string } | null>(null);
  const [announcement, setAnnouncement] = useState("");
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
    setAnnouncement(fillText(TEXTS.partMoved, { from: numberOf(from), to: numberOf(where) }));
    if (button !== null) setFocus({ place: where, button });
  }

  const composing: Composing = {
    played: byPlace,
    replace: (place, part) => onChange(replaced(document, place, part)),
    insert: (place, part) => onChange(inserted(document, place, part)),
    remove: (place) => onChange(removed(document, place)),
    canShift: (place, by) => neighbour(document, place, by) !== null,
    shift: (place, by) => {
      const to = neighbour(document, place, by);
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
          label={TEXTS.name}
          place="name"
          value={document.name}
          onChange={(name) => onChange({ ...document, name })}
        />
        <Text
          label={TEXTS.experimentTitle}
          place="title"
          value={document.title}
          onChange={(title) => onChange({ ...document, title })}
        />
      </div>
      {document.phases.map((phase, index) => (
        <fieldset key={phase.name} className={sequenceEditorStyles.phase}>
          <legend>{fillText(TEXTS.phase, { number: index + 1, title: phase.title })}</legend>
          <PartList
            place={["phases", index, "parts"]}
            parts={phase.parts as readonly Part[]}
            composing={composing}
          />
        </fieldset>
      ))}
      <output className={sequenceEditorStyles.unseen} aria-label={TEXTS.moved}>
        {announcement}
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
