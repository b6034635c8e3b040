/** What not all compared runs were set to alike. */

import { Table } from "@mantine/core";
import { Absent } from "../../components/Absent";
import { Unit } from "../../components/Unit";
import { settingValue } from "../../samples/format";
import { type Angles, readingOf } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import type { ComparedSetting, RunComparison } from "../../wire/types";
import page from "../Page.module.css";

/** Texts of more letters stand out by themselves. */
const LONG = 40;

export function DifferingSettings({ told: { settings, runs, reference } }: { told: RunComparison }) {
  const angles = useAngles();
  if (settings.length === 0) {
    return (
      <p className={page.empty}>All of these runs were set to the same, on the same plant and software.</p>
    );
  }
  const place = runs.findIndex(({ id }) => id === reference);
  return (
    <div className={page.tableScroll}>
      <Table aria-label="Settings that differ" verticalSpacing={4}>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>Setting or parameter that differs</Table.Th>
            {runs.map(({ id }) => (
              <Table.Th key={id} className={page.number}>
                Run {id}
              </Table.Th>
            ))}
            <Table.Th>Unit</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {settings.map((setting) => (
            <Table.Tr key={`${setting.name} ${setting.unit}`}>
              <Table.Td>{setting.name}</Table.Td>
              {runs.map(({ id }, index) => (
                <Table.Td key={id} className={page.number}>
                  <Value setting={setting} index={index} alike={place} angles={angles} />
                </Table.Td>
              ))}
              <Table.Td>
                <Unit unit={setting.unit} />
              </Table.Td>
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
    </div>
  );
}

interface ValueProps {
  readonly setting: ComparedSetting;
  readonly index: number;
  /** Place of the reference: who differs from it stands out. */
  readonly alike: number;
  readonly angles: Angles;
}

function Value({ setting: { values, unit }, index, alike, angles }: ValueProps) {
  const value = values[index] ?? null;
  if (value === null) return <Absent why="not set" />;
  const text = settingValue(typeof value === "number" ? value * readingOf(unit, angles).factor : value);
  if (value === values[alike]) return <span className={page.dim}>{text}</span>;
  return text.length > LONG ? text : <strong>{text}</strong>;
}
