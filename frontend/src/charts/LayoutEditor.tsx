/** The panels of the layout in use, one row each; every change is drawn and kept at once. */

import { Button } from "@mantine/core";
import { useRef, useState } from "react";
import { TbTrash } from "react-icons/tb";
import {
  allowedShare,
  type Edited,
  moved,
  renamed,
  withPanel,
  withShare,
  withSignal,
} from "../theme/editing";
import { useLayouts } from "../theme/useLayouts";
import type { ChartLayout } from "../wire/types";
import { EditedText } from "./EditedText";
import { FormulaEditor } from "./FormulaEditor";
import styles from "./LayoutEditor.module.css";
import { PanelRow } from "./PanelRow";
import { SignalTree } from "./SignalTree";
import { useHeightDrag } from "./useHeightDrag";
import { useSignalDrop } from "./useSignalDrop";

export function LayoutEditor() {
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
          <EditedText
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
