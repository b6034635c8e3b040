/** Studies as a table: how far each is, and how long it takes on. */

import { Table } from "@mantine/core";
import { Link } from "wouter";
import { dateTime } from "../../samples/format";
import type { Study } from "../../wire/types";
import page from "../Page.module.css";
import { StudyProgress } from "./StudyProgress";

export function StudyRows({ studies }: { studies: readonly Study[] }) {
  return (
    <div className={page.tableScroll}>
      <Table aria-label="Studies" highlightOnHover>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>Study</Table.Th>
            <Table.Th>Title</Table.Th>
            <Table.Th>Begun</Table.Th>
            <Table.Th>Who</Table.Th>
            <Table.Th>Progress</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {studies.map((study) => (
            <Table.Tr key={study.id}>
              <Table.Td>
                <Link href={`/studies/${study.id}`}>Study {study.id}</Link>
              </Table.Td>
              <Table.Td>{study.title}</Table.Td>
              <Table.Td style={{ whiteSpace: "nowrap" }}>{dateTime(study.created)}</Table.Td>
              <Table.Td>{study.who}</Table.Td>
              <Table.Td>
                <StudyProgress study={study} />
              </Table.Td>
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
    </div>
  );
}
