/** Which panels the charts have: a layout by name, its editor in place, and how the time axis tells time. */

import { ActionIcon, NativeSelect, Tooltip } from "@mantine/core";
import { useDisclosure } from "@mantine/hooks";
import { TbClock, TbLayoutRows } from "react-icons/tb";
import { usePreferences } from "../service/preferences";
import { READY } from "../theme/layouts";
import { useLayouts } from "../theme/useLayouts";
import { LayoutEditor } from "./LayoutEditor";

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
