/** Editor of a layout and of its derived signals. */

import { ActionIcon, Button, NativeSelect, Tooltip } from "@mantine/core";
import { useDisclosure } from "@mantine/hooks";
import { type FormEvent, useRef, useState } from "react";
import { TbClock, TbLayoutRows, TbPencil, TbTrash } from "react-icons/tb";
import { OperatorsOnly } from "../components/ControlMenu";
import { CommittedTextInput, TextField } from "../components/fields";
import { Refusal } from "../components/Refusal";
import { fillText } from "../samples/texts";
import { useFormulas, useRemoveFormula, useSaveFormula } from "../service/api/formulas";
import { usePreferences } from "../service/api/preferences";
import { isPlainRecord, isText, useDraft } from "../service/forms/drafts";
import { RefusedFields } from "../service/forms/refusals";
import {
  allowedShare,
  BUILT_IN_LAYOUTS,
  type Edited,
  moved,
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
import { TEXTS } from "./texts";

/** Derived signals: named expressions over signals, to draw, measure, compare and export. */

const EMPTY = { name: "", expression: "", unit: "1", meaning: "" };

function isFormula(value: unknown): value is typeof EMPTY {
  return isPlainRecord(value) && [value.name, value.expression, value.unit, value.meaning].every(isText);
}

export function FormulaEditor() {
  const formulas = useFormulas();
  const save = useSaveFormula();
  const remove = useRemoveFormula();
  const draft = useDraft("formula", EMPTY, isFormula);
  const text = draft.value;
  const set = (part: Partial<typeof EMPTY>) => draft.set((before) => ({ ...before, ...part }));
  const ready = text.name.trim() !== "" && text.expression.trim() !== "" && text.unit.trim() !== "";
  const changes = formulas.some(({ name }) => name === text.name.trim());

  function submit(event: FormEvent): void {
    event.preventDefault();
    if (!ready) return;
    save.mutate(
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
    <section aria-label={TEXTS.formulas} className={styles.formulas}>
      <span className={styles.name}>{TEXTS.formulas}</span>
      <ul className={styles.panels}>
        {formulas.map(({ name, expression, unit, meaning, who }) => (
          <li key={name} className={styles.formula}>
            <code>
              {name} = {expression}
            </code>
            <span className={styles.note}>
              {factsOf(unit === "1" ? TEXTS.dimensionless : unit, meaning, who)}
            </span>
            <OperatorsOnly>
              <Button
                size="compact-xs"
                variant="default"
                leftSection={<TbPencil size={12} />}
                aria-label={fillText(TEXTS.editNamed, { name })}
                onClick={() => draft.set({ name, expression, unit, meaning })}
              >
                {TEXTS.edit}
              </Button>
              <Button
                size="compact-xs"
                variant="default"
                leftSection={<TbTrash size={12} />}
                aria-label={fillText(TEXTS.removeNamed, { name })}
                onClick={() => remove.mutate(name)}
              >
                {TEXTS.remove}
              </Button>
            </OperatorsOnly>
          </li>
        ))}
      </ul>
      <OperatorsOnly>
        <RefusedFields error={save.error ?? remove.error} about={text}>
          <form className={styles.formulaForm} aria-label={TEXTS.formula} onSubmit={submit}>
            <TextField
              size="xs"
              w={130}
              name="name"
              label={TEXTS.name}
              maxLength={20}
              value={text.name}
              onChange={(name) => set({ name })}
            />
            <TextField
              size="xs"
              w={280}
              name="expression"
              label={TEXTS.expression}
              placeholder={TEXTS.expressionHint}
              maxLength={500}
              value={text.expression}
              onChange={(expression) => set({ expression })}
            />
            <TextField
              size="xs"
              w={80}
              name="unit"
              label={TEXTS.unit}
              maxLength={20}
              value={text.unit}
              onChange={(unit) => set({ unit })}
            />
            <TextField
              size="xs"
              w={180}
              name="meaning"
              label={TEXTS.meaning}
              maxLength={100}
              value={text.meaning}
              onChange={(meaning) => set({ meaning })}
            />
            <Button type="submit" size="compact-sm" disabled={!ready} loading={save.isPending}>
              {changes ? TEXTS.changeFormula : TEXTS.saveFormula}
            </Button>
          </form>
          <Refusal error={save.error ?? remove.error} about={text} forFields hint={TEXTS.formulaHint} />
        </RefusedFields>
      </OperatorsOnly>
    </section>
  );
}

function factsOf(unit: string, meaning: string, person: string): string {
  return meaning === ""
    ? fillText(TEXTS.formulaFacts, { unit, person })
    : fillText(TEXTS.formulaFactsWithMeaning, { unit, meaning, person });
}
/** Panels of the selected layout, one row each; every edit is drawn and stored at once. */

function LayoutEditor() {
  const { used, own, edit, remove } = useLayouts();
  const [refusal, refuse] = useState<string | null>(null);
  const isOwn = own.includes(used);
  const frame = useRef<HTMLElement>(null);

  const take = (how: (layout: ChartLayout) => Edited) => refuse(edit(how));
  useSignalDrop(frame, (name, title) =>
    take((layout) => {
      const place = layout.panels.findIndex((panel) => panel.title === title);
      return place < 0 ? fillText(TEXTS.panelGone, { title }) : withSignal(layout, place, name);
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
    <section ref={frame} className={styles.editor} aria-label={TEXTS.editor}>
      <div className={styles.head}>
        <span className={styles.name}>
          {TEXTS.layout}
          <CommittedTextInput
            label={TEXTS.layoutName}
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
            {TEXTS.removeLayout}
          </Button>
        ) : (
          <span className={styles.note}>{TEXTS.builtInHint}</span>
        )}
        <output className={styles.refusal} role="alert">
          {refusal}
        </output>
      </div>
      <SignalTree onPress={(name) => take((layout) => withPanel(layout, name))} />
      <ol className={styles.panels}>
        {used.panels.map((panel, place) => (
          <PanelRow
            // biome-ignore lint/suspicious/noArrayIndexKey: rows and their focus remain while panels move
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

/** Panels of the charts: choice of a layout, its editor, and the kind of the time axis. */

interface LayoutToolsProps {
  /** Whether the time of day is available. */
  readonly clock: boolean;
}

export function LayoutTools({ clock }: LayoutToolsProps) {
  const { used, own, choose } = useLayouts();
  const { preferences, known, change } = usePreferences();
  const [editing, edit] = useDisclosure(false);
  const names = (layouts: readonly { name: string }[]) => layouts.map(({ name }) => name);
  const clockHint = !clock ? TEXTS.clockImpossible : preferences.clock ? TEXTS.clockShown : TEXTS.clockHidden;
  return (
    <>
      <NativeSelect
        aria-label={TEXTS.layout}
        value={used.name}
        onChange={(event) => choose(event.currentTarget.value)}
        data={[
          { group: TEXTS.builtIn, items: names(BUILT_IN_LAYOUTS) },
          ...(own.length > 0 ? [{ group: TEXTS.custom, items: names(own) }] : []),
        ]}
        w={100}
      />
      <Tooltip label={TEXTS.editLayoutHint} position="top">
        <ActionIcon
          variant={editing ? "light" : "default"}
          size={30}
          aria-label={TEXTS.editLayout}
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
          aria-label={TEXTS.timeOfDay}
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
