/** Parts one after the other: the boxes of each, what it will do in words, what moves it. A loop has its parts within. */

import { ActionIcon, Button, NativeSelect } from "@mantine/core";
import type { DragEvent } from "react";
import { TbArrowDown, TbArrowUp, TbCopy, TbGripVertical, TbPlus, TbRepeat, TbX } from "react-icons/tb";
import { useAngles } from "../../service/angles";
import { useRefusedInput, useRefusedWithin } from "../../service/refusedFields";
import type { PartPlayed } from "../../wire/types";
import { innerOf, numberOf, type Part, type Place } from "./document";
import { ExpressionField } from "./ExpressionField";
import { PART_FORMS, partOf, stripped } from "./partForms";
import { partInWords, playedInWords } from "./partWords";
import styles from "./SequenceEditor.module.css";

/** What a row may ask of the editor it stands in. */
export interface Composing {
  /** By place; empty while what the service has laid out is of another text. */
  readonly played: ReadonlyMap<string, PartPlayed>;
  replace(place: Place, part: Part): void;
  insert(place: Place, part: Part): void;
  remove(place: Place): void;
  /** By one place, into loops and out of them; the button that asked keeps the focus. */
  shift(place: Place, by: -1 | 1): void;
  canShift(place: Place, by: -1 | 1): boolean;
  drag(from: Place, event: DragEvent): void;
  drop(before: Place): void;
}

interface PartListProps {
  readonly place: Place;
  readonly parts: readonly Part[];
  readonly composing: Composing;
}

/** With a place to drop a part and to add one at their end. */
export function PartList({ place, parts, composing }: PartListProps) {
  const end = [...place, parts.length];
  return (
    <ol className={styles.list}>
      {parts.map((part, index) => (
        <PartRow
          // biome-ignore lint/suspicious/noArrayIndexKey: a part is its place in the sequence
          key={index}
          part={part}
          place={[...place, index]}
          alone={parts.length === 1}
          composing={composing}
        />
      ))}
      <li
        className={styles.end}
        onDragOver={(event) => {
          event.preventDefault();
          event.stopPropagation();
        }}
        onDrop={(event) => {
          event.preventDefault();
          event.stopPropagation();
          composing.drop(end);
        }}
      >
        <Button
          variant="default"
          size="compact-xs"
          leftSection={<TbPlus size={13} />}
          aria-label={`Add part ${numberOf(end)}`}
          onClick={() => composing.insert(end, parts.at(-1) ?? partOf("hold"))}
        >
          Add part
        </Button>
      </li>
    </ol>
  );
}

interface PartRowProps {
  readonly part: Part;
  readonly place: Place;
  readonly alone: boolean;
  readonly composing: Composing;
}

function PartRow({ part, place, alone, composing }: PartRowProps) {
  const angles = useAngles();
  const key = place.join(".");
  const number = numberOf(place);
  const whose = `of part ${number}`;
  const saidAt = `refused-${key.replaceAll(".", "-")}`;
  const form = PART_FORMS[part.do];
  const kinds = Object.entries(PART_FORMS).map(([value, { words }]) => ({ value, label: words }));
  const { ref, said } = useRefusedInput<HTMLSelectElement>(key, saidAt);
  const set = (name: string, value: unknown) =>
    composing.replace(place, stripped({ ...part, [name]: value } as Part));
  const played = composing.played.get(key);
  return (
    <li
      className={styles.part}
      data-place={key}
      aria-label={`Part ${number}`}
      onDragOver={(event) => {
        event.preventDefault();
        event.stopPropagation();
      }}
      onDrop={(event) => {
        event.preventDefault();
        event.stopPropagation();
        composing.drop(place);
      }}
    >
      <div className={styles.head}>
        {/* biome-ignore lint/a11y/noStaticElementInteractions: the buttons beside it do the same by keyboard */}
        <span
          className={styles.grip}
          draggable
          title="Drag"
          onDragStart={(event) => composing.drag(place, event)}
        >
          <TbGripVertical size={14} aria-hidden />
          {number}
        </span>
        <NativeSelect
          ref={ref}
          size="xs"
          aria-label={`Kind ${whose}`}
          error={said !== null}
          data={form === undefined ? [{ value: part.do, label: part.do }, ...kinds] : kinds}
          value={part.do}
          onChange={(event) => composing.replace(place, partOf(event.currentTarget.value, part))}
        />
        <span className={styles.words}>
          {partInWords(part, angles)}
          {played && <span className={styles.played}> {playedInWords(part, played, angles)}</span>}
        </span>
        <span className={styles.buttons}>
          <RowButton
            words={`Move up part ${number}`}
            name="up"
            off={!composing.canShift(place, -1)}
            onClick={() => composing.shift(place, -1)}
          >
            <TbArrowUp size={14} />
          </RowButton>
          <RowButton
            words={`Move down part ${number}`}
            name="down"
            off={!composing.canShift(place, 1)}
            onClick={() => composing.shift(place, 1)}
          >
            <TbArrowDown size={14} />
          </RowButton>
          <RowButton
            words={`Repeat part ${number}`}
            name="repeat"
            onClick={() => composing.replace(place, { do: "repeat", times: 2, parts: [part] })}
          >
            <TbRepeat size={14} />
          </RowButton>
          <RowButton words={`Copy part ${number}`} name="copy" onClick={() => composing.insert(place, part)}>
            <TbCopy size={14} />
          </RowButton>
          <RowButton
            words={`Remove part ${number}`}
            name="remove"
            off={alone}
            onClick={() => composing.remove(place)}
          >
            <TbX size={14} />
          </RowButton>
        </span>
      </div>
      {form !== undefined && form.boxes.length > 0 && (
        <div className={styles.boxes}>
          {form.boxes.map(({ name, words, unit, optional, choices }) =>
            choices === undefined ? (
              <ExpressionField
                key={name}
                words={words}
                unit={unit}
                whose={whose}
                optional={optional}
                value={part[name] as number | string | undefined}
                place={`${key}.${name}`}
                saidAt={saidAt}
                onChange={(value) => set(name, value)}
              />
            ) : (
              <NativeSelect
                key={name}
                size="xs"
                label={words}
                aria-label={`${words} ${whose}`}
                data={optional ? [{ value: "", label: "unchanged" }, ...choices] : [...choices]}
                value={String(part[name] ?? (optional ? "" : choices[0]))}
                onChange={(event) => set(name, event.currentTarget.value || undefined)}
              />
            ),
          )}
        </div>
      )}
      <RowRefusal
        at={key}
        inner={innerOf(part).map(([inner]) => `${key}.${inner.join(".")}`)}
        id={saidAt}
        said={said}
      />
      {innerOf(part).map(([inner, parts]) => (
        <PartList key={inner.join(".")} place={[...place, ...inner]} parts={parts} composing={composing} />
      ))}
    </li>
  );
}

interface RowRefusalProps {
  readonly at: string;
  /** Where its inner parts are, which say for themselves what is refused in them. */
  readonly inner: readonly string[];
  readonly id: string;
  readonly said: string | null;
}

/** Below the row, as the boxes are too narrow for a sentence. */
function RowRefusal({ at, inner, id, said }: RowRefusalProps) {
  const within = useRefusedWithin(at, inner);
  const text = said ?? within;
  return text === null ? null : (
    <div id={id} role="alert" className={styles.refused}>
      {text}
    </div>
  );
}

interface RowButtonProps {
  readonly words: string;
  readonly name: string;
  readonly off?: boolean;
  readonly children: React.ReactNode;
  onClick(): void;
}

function RowButton({ words, name, off = false, children, onClick }: RowButtonProps) {
  return (
    <ActionIcon
      size={24}
      variant="subtle"
      color="gray"
      aria-label={words}
      title={words}
      data-button={name}
      aria-disabled={off}
      data-disabled={off || undefined}
      onClick={() => !off && onClick()}
    >
      {children}
    </ActionIcon>
  );
}
