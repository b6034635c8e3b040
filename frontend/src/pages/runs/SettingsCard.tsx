/** What a run was set to, with units. */

import { Table } from "@mantine/core";
import { Card } from "../../components/Card";
import { Explained } from "../../components/Explained";
import { Unit } from "../../components/Unit";
import { settingValue, short } from "../../samples/format";
import { angleText, labelWith, readingOf } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import { symbolEntry } from "../../service/glossary";
import type { Run } from "../../wire/types";
import { parseSegments, type Segment } from "../experiments/segments";
import page from "../Page.module.css";

export function SettingsCard({ settings }: { settings: Run["settings"] }) {
  const angles = useAngles();
  const sequence = settings.find(({ name }) => name === "segments");
  const segments = parseSegments(String(sequence?.value ?? ""));
  const plain = segments === null ? settings : settings.filter((setting) => setting !== sequence);
  return (
    <Card title="Settings">
      {segments !== null && <Segments segments={segments} />}
      {settings.length === 0 ? (
        <p className={page.empty}>No settings were stored with this run.</p>
      ) : (
        <div className={page.tableScroll}>
          <Table aria-label="Settings" verticalSpacing={2}>
            <Table.Thead>
              <Table.Tr>
                <Table.Th>Setting</Table.Th>
                <Table.Th>Symbol</Table.Th>
                <Table.Th className={page.number}>Value</Table.Th>
                <Table.Th>Unit</Table.Th>
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {plain.map(({ name, meaning, symbol, value, unit }) => (
                <Table.Tr key={name}>
                  <Table.Td>{meaning}</Table.Td>
                  <Table.Td>
                    <Explained of={symbolEntry(symbol) ?? symbolEntry(name)}>{symbol}</Explained>
                  </Table.Td>
                  <Table.Td className={page.number}>
                    {settingValue(typeof value === "number" ? value * readingOf(unit, angles).factor : value)}
                  </Table.Td>
                  <Table.Td>
                    <Unit unit={unit} />
                  </Table.Td>
                </Table.Tr>
              ))}
            </Table.Tbody>
          </Table>
        </div>
      )}
    </Card>
  );
}

function Segments({ segments }: { segments: readonly Segment[] }) {
  const angles = useAngles();
  return (
    <div className={page.tableScroll}>
      <Table aria-label="Segments" verticalSpacing={2}>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>Segment</Table.Th>
            <Table.Th>Shape</Table.Th>
            <Table.Th className={page.number}>Length [s]</Table.Th>
            <Table.Th className={page.number}>{labelWith("q_ref", "rad", angles)}</Table.Th>
            <Table.Th className={page.number}>S_ref [N·m/rad]</Table.Th>
            <Table.Th className={page.number}>Push [N]</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {segments.map((segment, index) => (
            // biome-ignore lint/suspicious/noArrayIndexKey: segments have a place and nothing else to tell them by
            <Table.Tr key={index}>
              <Table.Td>{index + 1}</Table.Td>
              <Table.Td>
                {segment.shape === "sine" ? `sine of ${short(Number(segment.period_s))} s` : segment.shape}
              </Table.Td>
              <Table.Td className={page.number}>{short(Number(segment.duration_s))}</Table.Td>
              <Table.Td className={page.number}>{angleText(Number(segment.q_ref), 2, angles)}</Table.Td>
              <Table.Td className={page.number}>{short(Number(segment.S_ref))}</Table.Td>
              <Table.Td className={page.number}>{short(Number(segment.F_push))}</Table.Td>
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
    </div>
  );
}
