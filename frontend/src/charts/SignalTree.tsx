import { TextInput } from "@mantine/core";
import { useState } from "react";
import { TbPlus } from "react-icons/tb";
import { SymbolText } from "../components/values";
import type { DerivedSignal } from "../samples/formula";
import { fillText } from "../samples/texts";
import { useDerived } from "../service/api/formulas";
import { DRAWN, meaningOf } from "../theme/signals";
import { DRAGGED } from "./gestures";
import styles from "./LayoutEditor.module.css";
import { TEXTS } from "./texts";

/** Signals to choose from, grouped by unit, with one unit first. Pure. */

interface Choices {
  readonly group: string;
  readonly items: { readonly value: string; readonly label: string }[];
}

/** `first`: unit of the panel, null for any unit; `derived`: additional derived signals. */
export function signalChoices(first: string | null, derived: readonly DerivedSignal[] = []): Choices[] {
  const all = [...DRAWN, ...derived.map(({ name, unit }) => ({ name, unit, meaning: meaningOf(name) }))];
  const units = [...new Set(all.map(({ unit }) => unit))];
  const ordered = first === null ? units : [first, ...units.filter((unit) => unit !== first)];
  return ordered.map((unit) => ({
    group: unit === "1" ? TEXTS.dimensionless : unit,
    items: all
      .filter((one) => one.unit === unit)
      .map(({ name, meaning }) => ({
        value: name,
        label: fillText(TEXTS.signalChoice, { signal: name, meaning }),
      })),
  }));
}

/** Choices whose name, meaning or unit contain every word of the search. */
export function found(choices: readonly Choices[], words: string): Choices[] {
  const wanted = words.toLowerCase().split(/\s+/).filter(Boolean);
  return choices
    .map(({ group, items }) => ({
      group,
      items: items.filter(({ label }) => {
        const text = `${label} ${group}`.toLowerCase();
        return wanted.every((word) => text.includes(word));
      }),
    }))
    .filter(({ items }) => items.length > 0);
}

/** All signals by unit, with a search: dragging adds one to a panel, + creates a panel for it. */

export function SignalTree({ onPress }: { onPress: (name: string) => void }) {
  const [words, search] = useState("");
  const groups = found(signalChoices(null, useDerived()), words);
  return (
    <section className={styles.tree} aria-label={TEXTS.signals}>
      <span className={styles.name}>
        {TEXTS.signals}
        <TextInput
          aria-label={TEXTS.searchSignals}
          placeholder={TEXTS.search}
          value={words}
          onChange={(event) => search(event.currentTarget.value)}
          w={160}
        />
        <span className={styles.note}>{TEXTS.signalsHint}</span>
      </span>
      {groups.length === 0 && <span className={styles.note}>{fillText(TEXTS.noSignal, { words })}</span>}
      <div className={styles.groups}>
        {groups.map(({ group, items }) => (
          // biome-ignore lint/a11y/useSemanticElements: a fieldset belongs to a form
          <div
            key={group}
            role="group"
            aria-label={fillText(TEXTS.signalsIn, { unit: group })}
            className={styles.group}
          >
            <span className={styles.note}>{group}</span>
            {items.map(({ value, label }) => (
              // biome-ignore lint/a11y/noStaticElementInteractions: the button and the lists of the panels do the same
              <span
                key={value}
                draggable
                className={styles.dragged}
                title={label}
                onDragStart={(event) => {
                  event.dataTransfer.effectAllowed = "copy";
                  event.dataTransfer.setData(DRAGGED, value);
                }}
              >
                <SymbolText name={value} />
                <button
                  type="button"
                  className={styles.own}
                  aria-label={fillText(TEXTS.newPanel, { signal: value })}
                  title={fillText(TEXTS.newPanel, { signal: value })}
                  onClick={() => onPress(value)}
                >
                  <TbPlus size={13} aria-hidden="true" />
                </button>
              </span>
            ))}
          </div>
        ))}
      </div>
    </section>
  );
}
