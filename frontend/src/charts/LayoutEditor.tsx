/** Editing of a layout and of the derived signals in it. */

import { ActionIcon, Button, NativeSelect, Tooltip } from "@mantine/core";
import { useDisclosure } from "@mantine/hooks";
import { type FormEvent, useRef, useState } from "react";
import { TbClock, TbLayoutRows, TbPencil, TbTrash } from "react-icons/tb";
import { OperatorsOnly } from "../components/ControlMenu";
import { CommittedTextInput, TextField } from "../components/fields";
import { Refusal } from "../components/Refusal";
import { useFormulas, useRemoveFormula, useSaveFormula } from "../service/api/formulas";
import { usePreferences } from "../service/api/preferences";
import { isPlainRecord, isText, useDraft } from "../service/forms/drafts";
import { RefusedFields } from "../service/forms/refusals";
import {
  allowedShare,
  type Edited,
  moved,
  READY,
  renamed,
  withPanel,
  withShare,
  withSignal,
} from "../theme/layouts";
import { useLayouts } from "../theme/useLayouts";
import type { ChartLayout } from "../wire/types";
import { useHeightDrag, useSignalDrop } from "./gestures";
import styles from "./LayoutEditor.module.css";
import { PanelRow } from "./PanelRow";
import { SignalTree } from "./SignalTree";

/** Derived signals: an expression over signals under a name, to draw, measure, compare and export. */

const EMPTY = { name: "", expression: "", unit: "1", meaning: "" };

function isFormula(value: unknown): value is typeof EMPTY {
  return isPlainRecord(value) && [value.name, value.expression, value.unit, value.meaning].every(isText);
}

export function FormulaEditor() {
  const formulas = useFormulas();
  const put = useSaveFormula();
  const remove = useRemoveFormula();
  const draft = useDraft("formula", EMPTY, isFormula);
  const text = draft.value;
  const set = (part: Partial<typeof EMPTY>) => draft.set((before) => ({ ...before, ...part }));
  const ready = text.name.trim() !== "" && text.expression.trim() !== "" && text.unit.trim() !== "";
  const changes = formulas.some(({ name }) => name === text.name.trim());

  function submit(event: FormEvent): void {
    event.preventDefault();
    if (!ready) return;
    put.mutate(
      {
        name: text.name.trim(),
        expression: text.expression.trim(),
        unit: text.unit.trim(),
        meaning: text.meaning.trim(),
      },
      { onSuccess: draft.discard },
    );
  }

  return (
    <section aria-label="Formulas" className={styles.formulas}>
      <span className={styles.name}>Formulas</span>
      <ul className={styles.panels}>
        {formulas.map(({ name, expression, unit, meaning, who }) => (
          <li key={name} className={styles.formula}>
            <code>
              {name} = {expression}
            </code>
            <span className={styles.note}>
              {unit === "1" ? "without unit" : unit}
              {meaning !== "" && `, ${meaning}`} ({who})
            </span>
            <OperatorsOnly>
              <Button
                size="compact-xs"
                variant="default"
                leftSection={<TbPencil size={12} />}
                aria-label={`Edit ${name}`}
                onClick={() => draft.set({ name, expression, unit, meaning })}
              >
                Edit
              </Button>
              <Button
                size="compact-xs"
                variant="default"
                leftSection={<TbTrash size={12} />}
                aria-label={`Remove ${name}`}
                onClick={() => remove.mutate(name)}
              >
                Remove
              </Button>
            </OperatorsOnly>
          </li>
        ))}
      </ul>
      <OperatorsOnly>
        <RefusedFields error={put.error ?? remove.error} about={text}>
          <form className={styles.formulaForm} aria-label="Formula" onSubmit={submit}>
            <TextField
              size="xs"
              w={130}
              name="name"
              label="Name"
              maxLength={20}
              value={text.name}
              onChange={(name) => set({ name })}
            />
            <TextField
              size="xs"
              w={280}
              name="expression"
              label="Expression (signals in SI)"
              placeholder="(F_A + F_B) / 2"
              maxLength={500}
              value={text.expression}
              onChange={(expression) => set({ expression })}
            />
            <TextField
              size="xs"
              w={80}
              name="unit"
              label="SI unit"
              maxLength={20}
              value={text.unit}
              onChange={(unit) => set({ unit })}
            />
            <TextField
              size="xs"
              w={180}
              name="meaning"
              label="Meaning"
              maxLength={100}
              value={text.meaning}
              onChange={(meaning) => set({ meaning })}
            />
            <Button type="submit" size="compact-sm" disabled={!ready} loading={put.isPending}>
              {changes ? "Change formula" : "Save formula"}
            </Button>
          </form>
          <Refusal
            error={put.error ?? remove.error}
            about={text}
            forFields
            hint="+ - * / % **, comparisons, and, or, not, if else, min, max, abs, sqrt, round, pi. No value: a gap."
          />
        </RefusedFields>
      </OperatorsOnly>
    </section>
  );
}

/** The panels of the layout in use, one row each; every change is drawn and kept at once. */

function LayoutEditor() {
  const { used, own, edit, remove } = useLayouts();
  const [refusal, refuse] = useState<string | null>(null);
  const isOwn = own.includes(used);
  const frame = useRef<HTMLElement>(null);

  const take = (how: (layout: ChartLayout) => Edited) => refuse(edit(how));
  useSignalDrop(frame, (name, title) =>
    take((layout) => {
      const place = layout.panels.findIndex((panel) => panel.title === title);
      return place < 0 ? `The layout has no panel “${title}” any more.` : withSignal(layout, place, name);
    }),
  );
  const grabbed = useRef(1);
  useHeightDrag(frame, (title, ratio, begins) => {
    const place = used.panels.findIndex((panel) => panel.title === title);
    const panel = used.panels[place];
    if (panel === undefined) return;
    if (begins) grabbed.current = panel.share;
    const share = allowedShare(grabbed.current * ratio);
    if (share !== panel.share) take((layout) => withShare(layout, place, share));
  });

  return (
    <section ref={frame} className={styles.editor} aria-label="Layout editor">
      <div className={styles.head}>
        <span className={styles.name}>
          Layout
          <CommittedTextInput
            label="Name of the layout"
            text={used.name}
            onDone={(text) => take((layout) => renamed(layout, text))}
          />
        </span>
        {isOwn ? (
          <Button
            variant="default"
            leftSection={<TbTrash size={14} />}
            onClick={() => {
              refuse(null);
              remove(used.name);
            }}
          >
            Remove layout
          </Button>
        ) : (
          <span className={styles.note}>Ready-made: the first change makes an own copy.</span>
        )}
        <output className={styles.refusal} role="alert">
          {refusal}
        </output>
      </div>
      <SignalTree onPress={(name) => take((layout) => withPanel(layout, name))} />
      <ol className={styles.panels}>
        {used.panels.map((panel, place) => (
          <PanelRow
            // biome-ignore lint/suspicious/noArrayIndexKey: a row stays where it is, and with it the focus; panels move
            key={place}
            layout={used}
            panel={panel}
            place={place}
            onEdit={take}
            onMove={(by) => take((layout) => moved(layout, place, by))}
          />
        ))}
      </ol>
      <FormulaEditor />
    </section>
  );
}

/** Which panels the charts have: a layout by name, its editor in place, and how the time axis tells time. */

interface LayoutToolsProps {
  /** There is a time of day to tell. */
  readonly clock: boolean;
}

export function LayoutTools({ clock }: LayoutToolsProps) {
  const { used, own, choose } = useLayouts();
  const { preferences, known, change } = usePreferences();
  const [editing, edit] = useDisclosure(false);
  const names = (layouts: readonly { name: string }[]) => layouts.map(({ name }) => name);
  const clockHint = !clock
    ? "Several recordings have no one time of day"
    : preferences.clock
      ? "Time of day; press for the time since the start"
      : "Time since the start; press for the time of day";
  return (
    <>
      <NativeSelect
        aria-label="Layout"
        value={used.name}
        onChange={(event) => choose(event.currentTarget.value)}
        data={[
          { group: "Ready-made", items: names(READY) },
          ...(own.length > 0 ? [{ group: "Own", items: names(own) }] : []),
        ]}
        w={100}
      />
      <Tooltip label="Panels and signals of the layout" position="top">
        <ActionIcon
          variant={editing ? "light" : "default"}
          size={30}
          aria-label="Edit layout"
          aria-pressed={editing}
          disabled={!known}
          onClick={edit.toggle}
        >
          <TbLayoutRows size={16} />
        </ActionIcon>
      </Tooltip>
      <Tooltip label={clockHint} position="top">
        <ActionIcon
          variant={clock && preferences.clock ? "light" : "default"}
          size={30}
          aria-label="Time of day"
          aria-pressed={clock && preferences.clock}
          aria-disabled={!clock}
          data-disabled={!clock || undefined}
          onClick={() => clock && change({ clock: !preferences.clock })}
        >
          <TbClock size={16} />
        </ActionIcon>
      </Tooltip>
      {editing && <LayoutEditor />}
    </>
  );
}
