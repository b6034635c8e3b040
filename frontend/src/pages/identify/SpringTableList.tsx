/** Springs identified from tables; not there while there is none. */

import { Button, Table } from "@mantine/core";
import { Card } from "../../components/Card";
import { dateTime } from "../../samples/format";
import type { SpringTable } from "../../wire/types";
import page from "../Page.module.css";

interface SpringTableListProps {
  readonly tables: readonly SpringTable[];
  readonly selected: number | null;
  onSelect(id: number | null): void;
}

export function SpringTableList({ tables, selected, onSelect }: SpringTableListProps) {
  if (tables.length === 0) return null;
  return (
    <Card title="Springs from tables">
      <div className={page.tableScroll}>
        <Table aria-label="Springs from tables">
          <Table.Tbody>
            {tables.map((table) => (
              <Table.Tr key={table.id} bg={table.id === selected ? "var(--accent-soft)" : undefined}>
                <Table.Td>{table.file}</Table.Td>
                <Table.Td style={{ whiteSpace: "nowrap" }}>{dateTime(table.created)}</Table.Td>
                <Table.Td>order {table.spring.recommended}</Table.Td>
                <Table.Td>{table.usable ? "usable" : "not usable"}</Table.Td>
                <Table.Td className={page.number}>
                  <Button
                    size="compact-xs"
                    variant="default"
                    aria-label={table.id === selected ? `Close ${table.file}` : `Show ${table.file}`}
                    onClick={() => onSelect(table.id === selected ? null : table.id)}
                  >
                    {table.id === selected ? "Close" : "Show"}
                  </Button>
                </Table.Td>
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      </div>
    </Card>
  );
}
