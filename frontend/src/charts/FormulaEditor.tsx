/** Derived signals: an expression over signals under a name, to draw, measure, compare and export. */

import { Button } from "@mantine/core";
import type { FormEvent } from "react";
import { TbPencil, TbTrash } from "react-icons/tb";
import { OperatorsOnly } from "../components/ControlMenu";
import { TextField } from "../components/fields";
import { Refusal } from "../components/Refusal";
import { isPlainRecord, isText, useDraft } from "../service/drafts";
import { RefusedFields } from "../service/refusals";
import { useFormulas, usePutFormula, useRemoveFormula } from "../service/signals";
import styles from "./LayoutEditor.module.css";

const EMPTY = { name: "", expression: "", unit: "1", meaning: "" };

function isFormula(value: unknown): value is typeof EMPTY {
  return isPlainRecord(value) && [value.name, value.expression, value.unit, value.meaning].every(isText);
}

export function FormulaEditor() {
  const formulas = useFormulas();
  const put = usePutFormula();
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
