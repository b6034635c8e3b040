/** All signals by unit with a search: drag one onto a panel to add it, press + for a panel of its own. */

import { TextInput } from "@mantine/core";
import { useState } from "react";
import { TbPlus } from "react-icons/tb";
import { Written } from "../components/SignalName";
import { useDerived } from "../service/formulas";
import styles from "./LayoutEditor.module.css";
import { found, signalChoices } from "./signalChoices";
import { DRAGGED } from "./useSignalDrop";

export function SignalTree({ onPress }: { onPress: (name: string) => void }) {
  const [words, search] = useState("");
  const groups = found(signalChoices(null, useDerived()), words);
  return (
    <section className={styles.tree} aria-label="Signals">
      <span className={styles.name}>
        Signals
        <TextInput
          aria-label="Search signals"
          placeholder="Search"
          value={words}
          onChange={(event) => search(event.currentTarget.value)}
          w={160}
        />
        <span className={styles.note}>
          Drag a signal onto a panel, or press + for a new one. Drag the lower edge of a panel to change its
          height.
        </span>
      </span>
      {groups.length === 0 && <span className={styles.note}>No signal matches “{words}”.</span>}
      <div className={styles.groups}>
        {groups.map(({ group, items }) => (
          // biome-ignore lint/a11y/useSemanticElements: a fieldset would be of a form
          <div key={group} role="group" aria-label={`Signals in ${group}`} className={styles.group}>
            <span className={styles.note}>{group}</span>
            {items.map(({ value, label }) => (
              // biome-ignore lint/a11y/noStaticElementInteractions: who does not drag has the button, and the lists of the panels
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
                <Written name={value} />
                <button
                  type="button"
                  className={styles.own}
                  aria-label={`New panel with ${value}`}
                  title={`New panel with ${value}`}
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
